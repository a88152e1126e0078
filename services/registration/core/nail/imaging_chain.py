"""From transmission to grey value: blur, the display's curve, edge enhancement."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.parameters import Unknown

_KERNEL_REACH = 4.0

Real = TypeVar("Real", np.float32, np.float64)

_STRAIGHT = 1e-6
# One-sided: what the second derivative adds is below a per cent.
_DERIVATIVE_STEP = 0.005
_MOST_CURVE = 5.0
_OF_BLUR = (Unknown.LOG_BLUR_PX, Unknown.TAIL_SHARE, Unknown.LOG_TAIL_WIDTH)
OF_SHARPENING = (Unknown.SHARPENING, Unknown.LOG_SHARPENING_WIDTH_PX)
# All unknowns that act on the picture after the rays.
OF_DISPLAY = tuple(Unknown)[Unknown.LOG_BLUR_PX : Unknown.CURVE_EXPONENT + 1]


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
class Stages:
    """The share that passes after each thing that happens to it, on the whole rectangle, shape of it."""

    blurred: NDArray[np.float64]
    bent: NDArray[np.float64]
    sharpened: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Display:
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

    def shown(self, passed: NDArray[Real]) -> NDArray[Real]:
        """What becomes of the share that passes."""
        return self.sharpened(self.bent(self.blurred(passed)))

    def stages(self, passed: NDArray[np.float64]) -> Stages:
        """The same, step by step."""
        blurred = self.blurred(passed)
        bent = self.bent(blurred)
        return Stages(blurred, bent, self.sharpened(bent))

    def blurred(self, image: NDArray[Real]) -> NDArray[Real]:
        """As the detector blurs the intensity."""
        core = blurred_image(image, self.blur_px)
        wide = blurred_image(core, float(np.sqrt(max(self.tail_px**2 - self.blur_px**2, 0.0))))
        return np.asarray(core + image.dtype.type(self.tail_share) * (wide - core), dtype=image.dtype)

    def bent(self, share: NDArray[Real]) -> NDArray[Real]:
        """Share of the grey step that a share of the intensity step makes."""
        return np.asarray(np.expm1(self.exponent * np.log1p(self.rise * share)) / self.grey_rise, dtype=share.dtype)

    def slope(self, before: Stages) -> NDArray[np.float64]:
        """Derivative of `bent` by the share, where both are known."""
        steepness = (1.0 + self.grey_rise * before.bent) / (1.0 + self.rise * before.blurred)
        return np.asarray(self.exponent * self.rise / self.grey_rise * steepness)

    def sharpened(self, image: NDArray[Real]) -> NDArray[Real]:
        """Edge enhancement: what differs from the surroundings is enlarged."""
        return (1.0 + self.sharpening) * image - self.sharpening * blurred_image(image, self.width_px)


def display_of(scale: Scale, parameters: NDArray[np.float64]) -> Display:
    """The display that the parameters stand for."""
    exponent = float(parameters[Unknown.CURVE_EXPONENT])
    if abs(exponent) < _STRAIGHT:
        exponent = _STRAIGHT
    # so that the bend hardly depends on the exponent
    curve = float(np.clip(2.0 * parameters[Unknown.CURVE] / (1.0 - exponent), _STRAIGHT, _MOST_CURVE))
    rise, grey_rise = float(np.expm1(curve)), float(np.expm1(exponent * curve))
    return _with_optics(Display(0.0, 0.0, 0.0, rise, grey_rise, exponent, 0.0, 0.0), scale, parameters)


def _with_optics(display: Display, scale: Scale, parameters: NDArray[np.float64]) -> Display:
    """A display with the same curve, and the parameters' blur and edge enhancement."""
    blur_px, width = np.exp(parameters[[Unknown.LOG_BLUR_PX, Unknown.LOG_TAIL_WIDTH]])
    return replace(
        display,
        blur_px=float(np.hypot(blur_px / scale.reduction, scale.smoothing)),
        tail_share=float(parameters[Unknown.TAIL_SHARE]),
        tail_px=float(np.hypot(width * blur_px / scale.reduction, scale.smoothing)),
        sharpening=float(parameters[Unknown.SHARPENING]),
        width_px=float(np.exp(parameters[Unknown.LOG_SHARPENING_WIDTH_PX])) / scale.reduction,
    )


def derivative_before_sharpening(
    unknown: Unknown,
    scale: Scale,
    parameters: NDArray[np.float64],
    passed: NDArray[np.float64],
    display: Display,
    before: Stages,
) -> NDArray[np.float32]:
    """Derivative of the bent share by one of the unknowns of blur and curve: a difference, and the curve's slope.

    Parameters
    ----------
    display, before
        The display of the parameters, and what it makes of what passed.
    """
    moved = _moved(unknown, parameters)
    if unknown in _OF_BLUR:
        change = display.slope(before) * (_with_optics(display, scale, moved).blurred(passed) - before.blurred)
    else:  # of the curve
        change = display_of(scale, moved).bent(before.blurred) - before.bent
    return np.asarray(change / _DERIVATIVE_STEP, dtype=np.float32)


def derivative_of_sharpening(
    unknown: Unknown, scale: Scale, parameters: NDArray[np.float64], display: Display, before: Stages
) -> NDArray[np.float32]:
    """Derivative of the sharpened share by one of the unknowns of the edge enhancement; parameters as above."""
    change = _with_optics(display, scale, _moved(unknown, parameters)).sharpened(before.bent) - before.sharpened
    return np.asarray(change / _DERIVATIVE_STEP, dtype=np.float32)


def _moved(unknown: Unknown, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    moved = parameters.copy()
    moved[unknown] += _DERIVATIVE_STEP
    return moved
