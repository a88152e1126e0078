"""Lengths declared in millimetres at the detector, in pixels of an image.

Blur, noise and the shadows of metal have their size in millimetres at the detector, so tuned lengths are declared in
millimetres (`_detector_mm`) and converted by the pixel pitch of the image at hand. The pitch is quantised to powers of
sqrt(2) around the usual one: images of about the usual pitch get the same lengths, whole pixels where they were chosen
as such, and a length in pixels is off by at most 19 %.
"""

import math
from typing import Final

USUAL_PIXEL_MM: Final = 0.235
"""Pixel pitch at the detector for which tuned lengths were chosen: a 9-inch field on about 1000 pixels."""
# Decimals of a length in pixels: rounding makes 1.41 mm / 0.235 mm exactly 6.
_DECIMALS = 9


def quantised_pitch_mm(pixel_mm: float) -> float:
    """The nearest of 0.235 mm times a power of sqrt(2), on a logarithmic scale.

    Parameters
    ----------
    pixel_mm
        Pixel pitch at the detector.

    Raises
    ------
    ValueError
        When the pitch is not a positive finite number.
    """
    if not (math.isfinite(pixel_mm) and pixel_mm > 0.0):
        raise ValueError(f"a pixel pitch is a positive number of millimetres, got {pixel_mm}")
    steps = round(2.0 * math.log2(pixel_mm / USUAL_PIXEL_MM))
    return float(USUAL_PIXEL_MM * 2.0 ** (0.5 * steps))


def pixels(length_mm: float, pixel_mm: float) -> float:
    """A length at the detector in pixels of an image.

    Parameters
    ----------
    length_mm
        Length at the detector, in mm.
    pixel_mm
        Pixel pitch of the image at the detector (`CArmCalibration.pixel_mm`), in mm.
    """
    return round(length_mm / quantised_pitch_mm(pixel_mm), _DECIMALS)


def whole_pixels(length_mm: float, pixel_mm: float) -> int:
    """The same as a whole number of pixels, at least 1."""
    return max(1, round(pixels(length_mm, pixel_mm)))


def pixels_or_more(length_mm: float, pixel_mm: float) -> float:
    """A length at the detector in pixels, not fewer than at the usual pitch, and not quantised.

    Fits of balls need as many pixels however coarse these are; their surroundings follow the pitch continuously.
    """
    return pixels(length_mm, USUAL_PIXEL_MM) * max(1.0, USUAL_PIXEL_MM / pixel_mm)
