"""Can this image be measured at all? Size, contrast, clipping."""

import numpy as np

from shared.errors import Reason, ReasonCode
from shared.figures import figure
from shared.xray.discs import FloatImage, Mask

LEAST_SIDE_PX = 256
LEAST_LEVELS = 16
CLIPPED_LIMIT = 0.6
CLIPPED_SUSPECT = 0.2
_SAMPLE = 25_000


def unusable_reason(pixels: FloatImage, usable: Mask) -> Reason | None:
    """Refuse what is too small, empty or clipped to be an X-ray image of anything.

    Parameters
    ----------
    pixels, usable
        Grey values and the pixels that hold X-rays, shape (rows, columns).
    """
    rows, columns = pixels.shape
    if min(rows, columns) < LEAST_SIDE_PX:
        return Reason(
            ReasonCode.IMAGE_UNUSABLE,
            f"the image has {columns} x {rows} pixels (at least {LEAST_SIDE_PX} each way); send the full image",
        )
    if not np.isfinite(pixels).all():
        return Reason(
            ReasonCode.IMAGE_UNUSABLE, "the image holds values that are not finite numbers (limit none); send it again"
        )
    values = pixels[usable]
    levels = len(np.unique(values[:: max(1, len(values) // _SAMPLE)]))
    if levels < LEAST_LEVELS:
        return Reason(
            ReasonCode.IMAGE_UNUSABLE,
            f"the image has only {levels} different grey values (at least {LEAST_LEVELS}); "
            "check exposure and collimation and take another image",
        )
    clipped = _clipped(values)
    return saturated_reason(clipped, CLIPPED_LIMIT) if clipped > CLIPPED_LIMIT else None


def clipped_fraction(pixels: FloatImage, usable: Mask) -> float:
    """Part of the usable pixels at the very brightest or the very darkest grey value."""
    return _clipped(pixels[usable])


def _clipped(values: FloatImage) -> float:
    return float(np.mean((values == values.max()) | (values == values.min())))


def saturated_reason(clipped: float, limit: float) -> Reason:
    """Refusal of an image in which too much is clipped."""
    return Reason(
        ReasonCode.SATURATED,
        f"{figure(100 * clipped, 100 * limit, 0)} % of the image is clipped to pure black or white (limit "
        f"{100 * limit:.0f} %); lower the exposure or collimate and take another image",
    )
