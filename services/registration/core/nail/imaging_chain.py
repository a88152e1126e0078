"""From transmission to grey value: blur, the display's curve, edge enhancement."""

from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.parameters import Parameter
from services.registration.core.tuning import FIT_REGION, NAIL_SOLVER
from shared.xray.pixel_scale import USUAL_PIXEL_MM

Real = TypeVar("Real", np.float32, np.float64)

# Guards: an exponent or bend of zero would divide by zero, a bend beyond five overflow single precision.
_LEAST_BEND, _LARGEST_BEND = 1e-6, 5.0
_BLUR_PARAMETERS = (Parameter.LOG_BLUR_PX, Parameter.TAIL_SHARE, Parameter.LOG_TAIL_WIDTH)
SHARPENING_PARAMETERS = (Parameter.SHARPENING, Parameter.LOG_SHARPENING_WIDTH_PX)
# All parameters that act on the image after the rays.
CHAIN_PARAMETERS = tuple(Parameter)[Parameter.LOG_BLUR_PX : Parameter.S_BEND + 1]


def blurred_image(image: NDArray[Real], sigma: float) -> NDArray[Real]:
    """Gaussian blur with edge values repeated, in the image's own precision."""
    kernel = _blur_kernel(sigma, FIT_REGION.kernel_reach)
    blurred = cv2.sepFilter2D(image, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, dtype=image.dtype)


# a set of derivatives blurs dozens of images by the same few widths
@lru_cache(maxsize=64)
def _blur_kernel(sigma: float, reach_sd: float) -> NDArray[np.float64]:
    # Not GaussianBlur: its kernel's length is odd in steps, so that the result would jump while a fit moves sigma.
    reach = max(1, int(np.ceil(reach_sd * sigma)))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(sigma, 1e-3)) ** 2)
    kernel /= kernel.sum()
    kernel.flags.writeable = False
    return np.asarray(kernel)


@dataclass(frozen=True, slots=True)
class Sampling:
    """How the image is sampled for a stage of the fit."""

    reduction: int  # side of a pixel of the reduced image in image pixels
    # Gaussian that the reduced image was smoothed with, in reduced pixels: it keeps the likelihood's surface smooth, so
    # that coarse fits converge in few steps
    smoothing_px: float
    pixel_mm: float  # pitch of the image at the detector (`quantised_pitch_mm`)

    @property
    def usual_pixel_px(self) -> float:
        """A pixel of the usual pitch, the unit of the fitted lengths, in image pixels (exactly 1 at that pitch)."""
        return USUAL_PIXEL_MM / self.pixel_mm

    def blur_px(self, parameters: NDArray[np.float64]) -> float:
        """Standard deviation of the detector's blur in image pixels."""
        return float(np.exp(parameters[Parameter.LOG_BLUR_PX])) * self.usual_pixel_px


@dataclass(frozen=True, slots=True, eq=False)
class ChainImages:
    """The visible fraction after each step of the imaging chain, shape (rows, columns) each."""

    blurred: NDArray[np.float64]
    curved: NDArray[np.float64]
    tone_mapped: NDArray[np.float64]
    sharpened: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ImagingChain:
    """Blur, display curve and edge enhancement with given parameters.

    The blur is a Gaussian with a wider one about it: light spreads further in a phosphor than its core does, and
    without the tail holes are estimated too wide. The curve is a power of the intensity (a logarithm when `exponent`
    is 0) between the dark and the bright side of an edge: `rise` is the bright intensity's excess over the dark one,
    over the dark one, and `grey_rise` the same of their powers. Local contrast enhancement bends the range between
    metal and background further, either way: `bulge` brightens its middle, `s_bend` steepens it. Widths are in pixels
    of the stage.
    """

    blur_px: float
    tail_share: float
    tail_px: float
    rise: float
    grey_rise: float
    exponent: float
    bulge: float
    s_bend: float
    sharpening: float
    sharpening_px: float

    def apply(self, transmission: NDArray[Real]) -> NDArray[Real]:
        """The visible fraction of the background, from the transmission."""
        return self.sharpened(self.tone_mapped(self.blurred(transmission)))

    def steps(self, transmission: NDArray[np.float64]) -> ChainImages:
        """The same, step by step."""
        blurred = self.blurred(transmission)
        curved = self.curved(blurred)
        tone_mapped = self.bent(curved)
        return ChainImages(blurred, curved, tone_mapped, self.sharpened(tone_mapped))

    def blurred(self, image: NDArray[Real]) -> NDArray[Real]:
        """Blur of the detector."""
        core = blurred_image(image, self.blur_px)
        wide = blurred_image(core, float(np.sqrt(max(self.tail_px**2 - self.blur_px**2, 0.0))))
        return np.asarray(core + image.dtype.type(self.tail_share) * (wide - core), dtype=image.dtype)

    def tone_mapped(self, fraction: NDArray[Real]) -> NDArray[Real]:
        """Fraction of the grey step for a fraction of the intensity step."""
        return self.bent(self.curved(fraction))

    def bent(self, grey: NDArray[Real]) -> NDArray[Real]:
        """The range between metal (0) and background (1) bent further; both ends stay."""
        between = grey * (1.0 - grey)
        return np.asarray(grey + between * (self.bulge + self.s_bend * (2.0 * grey - 1.0)), dtype=grey.dtype)

    def curved(self, fraction: NDArray[Real]) -> NDArray[Real]:
        """Fraction of the step of the intensity's power, or logarithm."""
        grey = np.expm1(self.exponent * np.log1p(self.rise * fraction)) / self.grey_rise
        return np.asarray(grey, dtype=fraction.dtype)

    def tone_slope(self, images: ChainImages) -> NDArray[np.float64]:
        """Derivative of `tone_mapped` by the fraction, where both are known."""
        steepness = (1.0 + self.grey_rise * images.curved) / (1.0 + self.rise * images.blurred)
        grey = images.curved
        by_bend = 1.0 + self.bulge * (1.0 - 2.0 * grey) + self.s_bend * (6.0 * grey * (1.0 - grey) - 1.0)
        return np.asarray(self.exponent * self.rise / self.grey_rise * steepness * by_bend)

    def sharpened(self, image: NDArray[Real]) -> NDArray[Real]:
        """Edge enhancement: differences from the surroundings are enlarged."""
        return (1.0 + self.sharpening) * image - self.sharpening * blurred_image(image, self.sharpening_px)


def imaging_chain(sampling: Sampling, parameters: NDArray[np.float64]) -> ImagingChain:
    """The imaging chain with the fit's parameters."""
    exponent = float(parameters[Parameter.CURVE_EXPONENT])
    if abs(exponent) < _LEAST_BEND:
        exponent = _LEAST_BEND
    # so that the bend hardly depends on the exponent
    curve = float(np.clip(2.0 * parameters[Parameter.CURVE] / (1.0 - exponent), _LEAST_BEND, _LARGEST_BEND))
    blur_px = sampling.blur_px(parameters)
    tail_px = float(np.exp(parameters[Parameter.LOG_TAIL_WIDTH])) * blur_px
    sharpening_px = float(np.exp(parameters[Parameter.LOG_SHARPENING_WIDTH_PX])) * sampling.usual_pixel_px
    return ImagingChain(
        blur_px=float(np.hypot(blur_px / sampling.reduction, sampling.smoothing_px)),
        tail_share=float(parameters[Parameter.TAIL_SHARE]),
        tail_px=float(np.hypot(tail_px / sampling.reduction, sampling.smoothing_px)),
        rise=float(np.expm1(curve)),
        grey_rise=float(np.expm1(exponent * curve)),
        exponent=exponent,
        bulge=float(parameters[Parameter.BULGE]),
        s_bend=float(parameters[Parameter.S_BEND]),
        sharpening=float(parameters[Parameter.SHARPENING]),
        sharpening_px=sharpening_px / sampling.reduction,
    )


def chain_derivative(
    parameter: Parameter,
    sampling: Sampling,
    parameters: NDArray[np.float64],
    transmission: NDArray[np.float64],
    images: ChainImages,
) -> NDArray[np.float32]:
    """Derivative by a parameter of the chain: of the sharpened fraction by edge enhancement, else of the tone-mapped.

    A difference; for the blur it is taken before the curve and multiplied by the curve's slope.

    Parameters
    ----------
    images
        Of the transmission through the chain with these parameters.
    """
    moved = parameters.copy()
    moved[parameter] += NAIL_SOLVER.derivative_step
    chain = imaging_chain(sampling, moved)
    if parameter in SHARPENING_PARAMETERS:
        change = chain.sharpened(images.tone_mapped) - images.sharpened
    elif parameter in _BLUR_PARAMETERS:
        change = chain.tone_slope(images) * (chain.blurred(transmission) - images.blurred)
    else:  # of the curve
        change = chain.tone_mapped(images.blurred) - images.tone_mapped
    return np.asarray(change / NAIL_SOLVER.derivative_step, dtype=np.float32)
