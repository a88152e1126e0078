"""The nail's two contour lines near its holes, from the steepest places across the band."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.coarse_band import SearchImage
from services.registration.core.nail.coarse_openings import HolePattern
from services.registration.core.subpixel import vertex_step
from shared.geometry.calibration import CArmCalibration
from shared.geometry.lines import read_only

_BEYOND_HOLES_MM = 10.0
_REACH_IN_WIDTHS = 0.16


@dataclass(frozen=True, slots=True, eq=False)
class Contour:
    """Both edges of the nail beside its holes.

    Attributes
    ----------
    ends_px
        Two edges, two ends each (proximal, distal), in measured pixels, shape (2, 2, 2).
    width_ideal_px
        Mean distance of the edges in ideal pixels.
    """

    ends_px: NDArray[np.float64]
    width_ideal_px: float


def measure_contour(image: SearchImage, calibration: CArmCalibration, pattern: HolePattern) -> Contour:
    """Fit a straight line to each edge, over the holes and a little beyond."""
    strip, scale = pattern.strip, pattern.px_per_mm
    along = (pattern.centre_search_px - strip.band.centre_px) @ strip.band.along - strip.first_along_px
    first = int(max(along.min() - _BEYOND_HOLES_MM * scale, 0))
    last = int(min(along.max() + _BEYOND_HOLES_MM * scale, strip.valid.size - 1))
    columns = np.arange(first, last + 1)
    edges = []
    for side in (-1.0, 1.0):
        rows = _steepest_rows(strip.grey[:, first : last + 1], strip.band.width_px, side)
        slope, offset = _robust_line(columns.astype(np.float64), rows)
        ends = columns[[0, -1]] if pattern.distal_sign > 0 else columns[[-1, 0]]
        edges.append([strip.search_px(float(c), float(offset + slope * c)) for c in ends])
    ideal = image.ideal_px(np.array(edges))
    separation = ideal[1] - ideal[0]
    run = ideal[0, 1] - ideal[0, 0]
    widths = np.abs(separation @ np.array([-run[1], run[0]])) / np.linalg.norm(run)
    return Contour(read_only(calibration.distortion.distort(ideal)), float(widths.mean()))


def _steepest_rows(grey: NDArray[np.float32], width_px: float, side: float) -> NDArray[np.float64]:
    """Row from the middle, to a fraction of a pixel, where it brightens most towards one side, for every column."""
    middle = grey.shape[0] // 2
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.0)
    slope = side * np.gradient(smooth, axis=0)
    reach = max(int(np.ceil(_REACH_IN_WIDTHS * width_px)), 2)
    centre = int(np.rint(middle + side * 0.5 * width_px))
    first = max(centre - reach, 1)
    window = slope[first : min(centre + reach + 1, slope.shape[0] - 1)]
    peak = first + window.argmax(axis=0)
    column = np.arange(grey.shape[1])
    steps = vertex_step(slope[peak - 1, column], slope[peak, column], slope[peak + 1, column])
    return np.asarray(peak - middle + steps, dtype=np.float64)


def _robust_line(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float]:
    """Slope and offset; points that lie off the line (a ball on the edge) are left out step by step."""
    used = np.ones(x.size, dtype=bool)
    slope, offset = 0.0, float(np.median(y))
    for _ in range(6):
        residual = y - (offset + slope * x)
        spread = max(1.48 * float(np.median(np.abs(residual[used]))), 0.3)
        used = np.abs(residual) < 2.5 * spread
        slope, offset = (float(v) for v in np.polyfit(x[used], y[used], 1))
    return slope, offset
