"""Can this image be measured at all? Contrast, clipping, motion."""

import numpy as np

from shared.errors import Reason, ReasonCode
from shared.xray.discs import Array, FloatImage, Mask

LEAST_SIDE_PX = 256
LEAST_LEVELS = 16
CLIPPED_LIMIT = 0.6
CLIPPED_SUSPECT = 0.2
_RIM_PX = (2.5, 5.0)
_LEAST_BALLS = 12


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
    levels = len(np.unique(pixels[usable][:: max(1, usable.sum() // 100_000)]))
    if levels < LEAST_LEVELS:
        return Reason(
            ReasonCode.IMAGE_UNUSABLE,
            f"the image has only {levels} different grey values (at least {LEAST_LEVELS}); "
            "check exposure and collimation and take another image",
        )
    clipped = clipped_fraction(pixels, usable)
    return saturated_reason(clipped, CLIPPED_LIMIT) if clipped > CLIPPED_LIMIT else None


def clipped_fraction(pixels: FloatImage, usable: Mask) -> float:
    """Part of the usable pixels at the very brightest or the very darkest grey value."""
    values = pixels[usable]
    return float(np.mean((values == values.max()) | (values == values.min())))


def saturated_reason(clipped: float, limit: float) -> Reason:
    """Refusal of an image in which too much is clipped."""
    return Reason(
        ReasonCode.SATURATED,
        f"{100 * clipped:.0f} % of the image is clipped to pure black or white (limit {100 * limit:.0f} %); "
        "lower the exposure or collimate and take another image",
    )


def motion_blur_px(pixels: FloatImage, centre_px: Array, radius_px: Array) -> float:
    """Length of a straight movement during the exposure that would explain how elongated the balls are.

    A movement over L pixels adds L^2/12 to the balls' second moment along it; distortion stretches balls too, but
    radially, so that it averages out over the image.

    Parameters
    ----------
    pixels
        Grey values, shape (rows, columns).
    centre_px, radius_px
        Isolated balls, shapes (N, 2) and (N,).

    Returns
    -------
    float
        Zero when fewer than twelve balls can be judged.
    """
    moments = [m for c, r in zip(centre_px, radius_px, strict=True) if (m := _moments(pixels, c, float(r))) is not None]
    if len(moments) < _LEAST_BALLS:
        return 0.0
    stretch, shear = np.median(np.array(moments), axis=0)
    return float(np.sqrt(12.0 * np.hypot(stretch, 2.0 * shear)))


def _moments(pixels: FloatImage, centre: Array, radius: float) -> tuple[float, float] | None:
    """Difference of the second moments along x and y, and the mixed moment, in square pixels."""
    reach = int(np.ceil(radius + _RIM_PX[1]))
    column, row = np.round(centre).astype(int)
    if column < reach or row < reach or row + reach >= pixels.shape[0] or column + reach >= pixels.shape[1]:
        return None
    patch = pixels[row - reach : row + reach + 1, column - reach : column + reach + 1].astype(np.float64)
    y, x = np.mgrid[row - reach : row + reach + 1, column - reach : column + reach + 1]
    dx, dy = x - centre[0], y - centre[1]
    distance = np.hypot(dx, dy)
    rim = (distance > radius + _RIM_PX[0]) & (distance <= radius + _RIM_PX[1])
    plane = np.column_stack([np.ones(rim.sum()), dx[rim], dy[rim]])
    a, b, c = np.linalg.lstsq(plane, patch[rim], rcond=None)[0]
    shade = np.where(distance <= radius + _RIM_PX[0], a + b * dx + c * dy - patch, 0.0)
    total = float(shade.sum())
    if total <= 0.0:
        return None
    stretch = float((shade * (dx**2 - dy**2)).sum() / total)
    return stretch, float((shade * dx * dy).sum() / total)
