"""Pixels, rows and columns of a detector that do not answer: found as isolated outliers and filled in."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from shared.xray.tuning import DEAD_PIXELS


@dataclass(frozen=True, slots=True, eq=False)
class FilledImage:
    """An image without dead pixels.

    Attributes
    ----------
    pixels
        Grey values; those of dead pixels are the median of their neighbourhood, shape (rows, columns).
    dead
        Which ones are, shape (rows, columns).
    """

    pixels: NDArray[np.float32]
    dead: NDArray[np.bool_]


def fill_dead_pixels(pixels: NDArray[np.float32]) -> FilledImage:
    """Find pixels that stand out from their neighbourhood by more than its structure and noise, and fill them in.

    Structure is what the neighbourhood's median varies by: at an edge, or in a thin wire, nothing stands out by more.

    Parameters
    ----------
    pixels
        Image as received, shape (rows, columns).
    """
    s = DEAD_PIXELS
    neighbourhood = np.ones((s.neighbourhood_px, s.neighbourhood_px), dtype=np.uint8)
    middle = cv2.medianBlur(pixels, s.neighbourhood_px)
    structure = cv2.dilate(middle, neighbourhood) - cv2.erode(middle, neighbourhood)
    apart = np.abs(pixels - middle)
    spread = cv2.boxFilter(apart, -1, (s.noise_window_px, s.noise_window_px))
    least = s.least_share_of_range * float(
        np.ptp(np.percentile(pixels, (s.darkest_percentile, s.brightest_percentile)))
    )
    dead = _with_whole_lines(apart > structure + np.maximum(s.limit_in_spreads * spread, least))
    return FilledImage(np.where(dead, middle, pixels), dead)


def _with_whole_lines(dead: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The same, and every row and column of which so much is dead that all of it must be."""
    rows, columns = (dead.mean(axis=axis) > DEAD_PIXELS.dead_share_of_line for axis in (1, 0))
    return np.asarray(dead | rows[:, None] | columns[None, :])
