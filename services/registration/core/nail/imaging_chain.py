"""From transmission to grey value: blur, the display's curve, edge enhancement."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.parameters import Parameter

_KERNEL_REACH = 4.0

Real = TypeVar("Real", np.float32, np.float64)

_STRAIGHT = 1e-6
# One-sided: what the second derivative adds is below a per cent.
_DERIVATIVE_STEP = 0.005
_MOST_CURVE = 5.0
_BLUR_PARAMETERS = (Parameter.LOG_BLUR_PX, Parameter.TAIL_SHARE, Parameter.LOG_TAIL_WIDTH)
SHARPENING_PARAMETERS = (Parameter.SHARPENING, Parameter.LOG_SHARPENING_WIDTH_PX)
# All unknowns that act on the picture after the rays.
CHAIN_PARAMETERS = tuple(Parameter)[Parameter.LOG_BLUR_PX : Parameter.CURVE_EXPONENT + 1]


def blurred_image(image: NDArray[Real], sigma: float) -> NDArray[Real]:
    """Gaussian blur with edge values repeated, in the image's own precision."""
    kernel = _kernel(sigma)
    blurred = cv2.sepFilter2D(image, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, dtype=image.dtype)


# a set of derivatives blurs dozens of pictures by the same few widths
@lru_cache(maxsize=64)
def _kernel(sigma: float) -> NDArray[np.float64]:
    # Not GaussianBlur: its kernel's length is odd in steps, so that the result would jump while a fit moves sigma.
    reach = max(1, int(np.ceil(_KERNEL_REACH * sigma)))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(sigma, 1e-3)) ** 2)
    kernel /= kernel.sum()
    kernel.flags.writeable = False
    return np.asarray(kernel)


@dataclass(frozen=True, slots=True)
class Scale:
    """How coarsely the image is compared.

    Attributes
    ----------
    reduction
        Side of a pixel of the reduced image in image pixels.
    smoothing
        Gaussian that the reduced image was smoothed with, in reduced pixels: it keeps the likelihood's surface smooth,
        so that coarse fits find their optimum in few steps.
    """

    reduction: int
    smoothing: float


@dataclass(frozen=True, slots=True, eq=False)
class ChainImages:
    """The share that passes after each thing that happens to it, on the whole rectangle, shape of it."""

    blurred: NDArray[np.float64]
    tone_mapped: NDArray[np.float64]
    sharpened: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ImagingChain:
    """What happens to the intensity on its way to the grey value.

    The blur is a Gaussian with a wider one about it: light spreads further in a phosphor than its core does, and
    a tail that is not modelled passes for wider holes. The curve is a power of the intensity (a logarithm when
    `exponent` is 0), of which an edge shows the part from dark to bright: `rise` is by how much the bright intensity
    exceeds the dark one, over the dark one, and `grey_rise` the same of their powers.
    """

    blur_px: float
    tail_share: float
    tail_px: float
    rise: float
    grey_rise: float
    exponent: float
    sharpening: float
    width_px: float

    def apply(self, transmission: NDArray[Real]) -> NDArray[Real]:
        """What becomes of the share that passes."""
        return self.sharpened(self.tone_mapped(self.blurred(transmission)))

    def stages(self, transmission: NDArray[np.float64]) -> ChainImages:
        """The same, step by step."""
        blurred = self.blurred(transmission)
        tone_mapped = self.tone_mapped(blurred)
        return ChainImages(blurred, tone_mapped, self.sharpened(tone_mapped))

    def blurred(self, image: NDArray[Real]) -> NDArray[Real]:
        """As the detector blurs the intensity."""
        core = blurred_image(image, self.blur_px)
        wide = blurred_image(core, float(np.sqrt(max(self.tail_px**2 - self.blur_px**2, 0.0))))
        return np.asarray(core + image.dtype.type(self.tail_share) * (wide - core), dtype=image.dtype)

    def tone_mapped(self, share: NDArray[Real]) -> NDArray[Real]:
        """Share of the grey step that a share of the intensity step makes."""
        return np.asarray(np.expm1(self.exponent * np.log1p(self.rise * share)) / self.grey_rise, dtype=share.dtype)

    def slope(self, before: ChainImages) -> NDArray[np.float64]:
        """Derivative of `tone_mapped` by the share, where both are known."""
        steepness = (1.0 + self.grey_rise * before.tone_mapped) / (1.0 + self.rise * before.blurred)
        return np.asarray(self.exponent * self.rise / self.grey_rise * steepness)

    def sharpened(self, image: NDArray[Real]) -> NDArray[Real]:
        """Edge enhancement: what differs from the surroundings is enlarged."""
        return (1.0 + self.sharpening) * image - self.sharpening * blurred_image(image, self.width_px)


def imaging_chain_of(scale: Scale, parameters: NDArray[np.float64]) -> ImagingChain:
    """The display that the parameters stand for."""
    exponent = float(parameters[Parameter.CURVE_EXPONENT])
    if abs(exponent) < _STRAIGHT:
        exponent = _STRAIGHT
    # so that the bend hardly depends on the exponent
    curve = float(np.clip(2.0 * parameters[Parameter.CURVE] / (1.0 - exponent), _STRAIGHT, _MOST_CURVE))
    rise, grey_rise = float(np.expm1(curve)), float(np.expm1(exponent * curve))
    return _with_optics(ImagingChain(0.0, 0.0, 0.0, rise, grey_rise, exponent, 0.0, 0.0), scale, parameters)


def _with_optics(display: ImagingChain, scale: Scale, parameters: NDArray[np.float64]) -> ImagingChain:
    """A display with the same curve, and the parameters' blur and edge enhancement."""
    blur_px, width = np.exp(parameters[[Parameter.LOG_BLUR_PX, Parameter.LOG_TAIL_WIDTH]])
    return replace(
        display,
        blur_px=float(np.hypot(blur_px / scale.reduction, scale.smoothing)),
        tail_share=float(parameters[Parameter.TAIL_SHARE]),
        tail_px=float(np.hypot(width * blur_px / scale.reduction, scale.smoothing)),
        sharpening=float(parameters[Parameter.SHARPENING]),
        width_px=float(np.exp(parameters[Parameter.LOG_SHARPENING_WIDTH_PX])) / scale.reduction,
    )


def derivative_before_sharpening(
    unknown: Parameter,
    scale: Scale,
    parameters: NDArray[np.float64],
    transmission: NDArray[np.float64],
    display: ImagingChain,
    before: ChainImages,
) -> NDArray[np.float32]:
    """Derivative of the bent share by one of the unknowns of blur and curve: a difference, and the curve's slope.

    Parameters
    ----------
    display, before
        The display of the parameters, and what it makes of what passed.
    """
    moved = _moved(unknown, parameters)
    if unknown in _BLUR_PARAMETERS:
        change = display.slope(before) * (_with_optics(display, scale, moved).blurred(transmission) - before.blurred)
    else:  # of the curve
        change = imaging_chain_of(scale, moved).tone_mapped(before.blurred) - before.tone_mapped
    return np.asarray(change / _DERIVATIVE_STEP, dtype=np.float32)


def derivative_of_sharpening(
    unknown: Parameter, scale: Scale, parameters: NDArray[np.float64], display: ImagingChain, before: ChainImages
) -> NDArray[np.float32]:
    """Derivative of the sharpened share by one of the unknowns of the edge enhancement; parameters as above."""
    change = _with_optics(display, scale, _moved(unknown, parameters)).sharpened(before.tone_mapped) - before.sharpened
    return np.asarray(change / _DERIVATIVE_STEP, dtype=np.float32)


def _moved(unknown: Parameter, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    moved = parameters.copy()
    moved[unknown] += _DERIVATIVE_STEP
    return moved
