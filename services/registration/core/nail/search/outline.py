"""Outlines in the image as received: of a hole's opening, and of the nail's two edges."""

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.robust import inliers, robust_spread
from services.registration.core.nail.search.band import SearchImage
from services.registration.core.nail.search.holes import HolePattern
from services.registration.core.subpixel import subpixel_offset
from services.registration.core.tuning import NAIL_CONTOUR, OPENING_OUTLINE
from shared.geometry.calibration import CArmCalibration
from shared.geometry.lines import read_only
from shared.xray.pixel_scale import pixels as pixels_of
from shared.xray.pixel_scale import whole_pixels


@dataclass(frozen=True, slots=True, eq=False)
class Ellipse:
    """An ellipse in an image; that of a slot is cut in two, with the slot's straight part between its halves."""

    centre_px: NDArray[np.float64]  # shape (2,)
    semi_axes_px: tuple[float, float]  # major, then minor
    major_axis_rad: float  # direction of the major axis, from +x to +y
    # From the slot's middle to where either half begins, shape (2,); zero of a bore
    half_slot_px: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))

    @property
    def reach_px(self) -> float:
        """From the centre to the farthest point of the outline, at most."""
        return self.semi_axes_px[0] + float(np.linalg.norm(self.half_slot_px))

    def signed_distance_px(self, points_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """First-order distance of points, shape (N, 2), from the outline; positive outside, shape (N,)."""
        turn = np.array([np.cos(self.major_axis_rad), np.sin(self.major_axis_rad)])
        offset = points_px - self.centre_px
        offset = offset - _along_slot(offset, self.half_slot_px)
        along, across = offset @ turn, offset @ np.array([-turn[1], turn[0]])
        a, b = self.semi_axes_px
        level = np.hypot(along / a, across / b)
        slope = np.hypot(along / a**2, across / b**2) / np.maximum(level, 1e-9)
        return np.asarray((level - 1.0) / np.maximum(slope, 1e-9))


def _along_slot(offset_px: NDArray[np.float64], half_slot_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """The nearest point of a slot's middle line, for offsets from its middle, shape (N, 2)."""
    length_px = float(np.linalg.norm(half_slot_px))
    if length_px == 0.0:
        return np.zeros_like(offset_px)
    direction = half_slot_px / length_px
    return np.clip(offset_px @ direction, -length_px, length_px)[:, None] * direction


@dataclass(frozen=True, slots=True, eq=False)
class Opening:
    """The visible opening of one nail hole."""

    hole_id: str  # name of the hole in the nail's file
    # Points of the outline in measured pixels, those that the ellipse explains, shape (M, 2)
    outline_px: NDArray[np.float64]
    ellipse: Ellipse  # fitted in ideal pixels, where perspective is undistorted
    # Part of the directions from the centre in which the outline was found (the rest is covered or blurred away)
    seen_fraction: float


def measure_opening(
    pixels: NDArray[np.generic],
    calibration: CArmCalibration,
    hole_id: str,
    centre_px: NDArray[np.float64],
    radius_px: float,
    half_slot_px: NDArray[np.float64],
) -> Opening | None:
    """Outline of an opening about a proposed centre; None when too little of it can be seen.

    The outline is where the grey value crosses the middle between the opening's and the metal's, going outwards. Balls
    that cover a part give points too far inside, which the fit leaves out.

    Parameters
    ----------
    pixels
        Un-mirrored image, shape (height, width).
    centre_px
        Proposed centre in measured pixels, shape (2,).
    radius_px
        Radius that the hole would have if seen along its axis; of a slot that of its ends.
    half_slot_px
        From a slot's middle to the centre of either end, shape (2,): the outline is searched about both, and its halves
        are put together before an ellipse is fitted. Zero of a bore.
    """
    pixel_mm = calibration.pixel_mm
    reach_px = radius_px + float(np.linalg.norm(half_slot_px))
    grey, corner_px = _surroundings(pixels, centre_px, reach_px, pixel_mm)
    centre = centre_px
    for _ in range(2):
        points, ends_px = _crossings(grey, centre - corner_px, radius_px, pixel_mm, half_slot_px)
        if len(points) < OPENING_OUTLINE.least_points:
            return None
        tail = OPENING_OUTLINE.extent_percentile
        points = points + corner_px
        centre = np.asarray(np.percentile(points - ends_px, (tail, 100.0 - tail), axis=0).mean(axis=0))
    ideal = calibration.distortion.undistort(points) - ends_px
    fitted = _fit_without_covered(ideal, radius_px, pixel_mm)
    if fitted is None:
        return None
    ellipse, used = fitted
    seen = float(np.count_nonzero(used)) / OPENING_OUTLINE.directions
    return Opening(hole_id, read_only(points[used]), replace(ellipse, half_slot_px=read_only(half_slot_px)), seen)


def _surroundings(
    pixels: NDArray[np.generic], centre_px: NDArray[np.float64], radius_px: float, pixel_mm: float
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Smoothed grey values where the outline is searched, and the place of their first pixel, shape (2,)."""
    margin_px = whole_pixels(OPENING_OUTLINE.smoothing_reach_detector_mm, pixel_mm)
    half_px = OPENING_OUTLINE.centre_off_in_reaches * OPENING_OUTLINE.reach_in_radii * radius_px
    reach = int(np.ceil(half_px)) + margin_px
    limit = np.array(pixels.shape[::-1])
    low = np.clip(np.rint(centre_px).astype(int) - reach, 0, limit - 1)
    high = np.clip(np.rint(centre_px).astype(int) + reach + 1, low + 1, limit)
    block = pixels[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    sigma = pixels_of(OPENING_OUTLINE.smoothing_detector_mm, pixel_mm)
    return np.asarray(cv2.GaussianBlur(block, (0, 0), sigma), dtype=np.float32), low.astype(np.float64)


def _crossings(
    grey: NDArray[np.float32],
    centre_px: NDArray[np.float64],
    radius_px: float,
    pixel_mm: float,
    half_slot_px: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the grey value falls through the middle level on rays from the centre, or from the ends of a slot.

    Returns
    -------
    tuple of arrays
        The points, and where the ray of each begins, from the centre; shape (M, 2) both.
    """
    s, step_px = OPENING_OUTLINE, pixels_of(OPENING_OUTLINE.step_detector_mm, pixel_mm)
    angles = np.linspace(0.0, 2.0 * np.pi, s.directions, endpoint=False)
    distances = np.arange(0.0, s.reach_in_radii * radius_px, step_px)
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    ends_px = np.sign(rays @ half_slot_px)[:, None] * half_slot_px
    where = (centre_px + ends_px[:, None, :] + rays[:, None, :] * distances[None, :, None]).astype(np.float32)
    profile = cv2.remap(grey, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    bright = float(np.percentile(profile[:, distances < s.bright_within_radii * radius_px], s.bright_percentile))
    # Along the band the metal reaches far, across it the band's edge is near: the darkest quarter is metal.
    dark = float(np.percentile(profile[:, distances > s.dark_beyond_radii * radius_px], s.dark_percentile))
    below = profile < 0.5 * (bright + dark)
    # Outermost crossing: nothing bright may follow within the band, and a ball inside the opening does not count.
    inner = distances[None, :] < s.inner_in_radii * radius_px
    last_bright = distances.size - 1 - np.argmax((~below & inner)[:, ::-1], axis=1)
    found = (~below & inner).any(axis=1) & (last_bright < np.count_nonzero(inner[0]) - 1)
    row, column = np.flatnonzero(found), last_bright[found]
    here, after = profile[row, column], profile[row, column + 1]
    fraction = (here - 0.5 * (bright + dark)) / np.maximum(here - after, 1e-9)
    distance = (column + np.clip(fraction, 0.0, 1.0)) * step_px
    return np.asarray(centre_px + ends_px[row] + rays[row] * distance[:, None]), ends_px[row]


def _fit_without_covered(
    points_px: NDArray[np.float64], radius_px: float, pixel_mm: float
) -> tuple[Ellipse, NDArray[np.bool_]] | None:
    """Fit, leave out points off the outline, fit again: first those far inside, where a ball covers it."""
    s, least_px = OPENING_OUTLINE, pixels_of(OPENING_OUTLINE.least_tolerance_detector_mm, pixel_mm)
    smallest_px, largest_px = s.least_semi_axis_in_radii * radius_px, s.largest_semi_axis_in_radii * radius_px
    used = np.ones(len(points_px), dtype=bool)
    ellipse: Ellipse | None = None
    for attempt in range(s.rounds):
        if np.count_nonzero(used) < s.least_points:
            return None
        ellipse = fit_ellipse(points_px[used])
        if ellipse is None or not smallest_px < ellipse.semi_axes_px[0] < largest_px:
            return None
        residual = ellipse.signed_distance_px(points_px)
        residual = residual - np.median(residual[used])
        deviations = s.first_tolerance_sd - s.tolerance_step_sd * attempt
        tolerance = max(least_px, deviations * robust_spread(residual[used]))
        used = (residual > -tolerance) & (residual < s.outer_tolerance * tolerance)
    return None if ellipse is None else (ellipse, used)


def fit_ellipse(points_px: NDArray[np.float64]) -> Ellipse | None:
    """Ellipse through points, shape (M, 2), M >= 5, by direct least squares; None when there is none."""
    centre = points_px.mean(axis=0)
    (x, y), (width, height), angle_deg = cv2.fitEllipseDirect((points_px - centre).astype(np.float32))
    if not np.isfinite([x, y, width, height]).all() or min(width, height) <= 0.0:
        return None
    angle = np.radians(angle_deg) + (np.pi / 2.0 if height > width else 0.0)
    major, minor = max(width, height), min(width, height)
    return Ellipse(read_only(centre + np.array([x, y])), (0.5 * major, 0.5 * minor), float(angle % np.pi))


def band_width_ideal_px(image: SearchImage, pattern: HolePattern) -> float:
    """Mean distance of the nail's edges, each a straight line over the holes and a little beyond, in ideal pixels."""
    strip, scale = pattern.strip, pattern.px_per_mm
    along = (pattern.centre_search_px - strip.band.centre_px) @ strip.band.along - strip.first_along_px
    first = int(max(along.min() - NAIL_CONTOUR.beyond_holes_mm * scale, 0))
    last = int(min(along.max() + NAIL_CONTOUR.beyond_holes_mm * scale, strip.valid.size - 1))
    columns = np.arange(first, last + 1)
    edges = []
    for side in (-1.0, 1.0):
        rows = _edge_rows(strip.grey[:, first : last + 1], strip.band.width_px, side)
        slope, offset = _robust_line(columns.astype(np.float64), rows)
        edges.append([strip.search_px(float(c), float(offset + slope * c)) for c in columns[[0, -1]]])
    ideal = image.ideal_px(np.array(edges))
    separation = ideal[1] - ideal[0]
    run = ideal[0, 1] - ideal[0, 0]
    return float((np.abs(separation @ np.array([-run[1], run[0]])) / np.linalg.norm(run)).mean())


def _edge_rows(grey: NDArray[np.float32], width_px: float, side: float) -> NDArray[np.float64]:
    """Row from the middle, to a fraction of a pixel, where it brightens towards one side, for every column.

    Of several steep places the innermost is the nail's edge: bone brightens further out, in processed images as
    steeply.
    """
    middle = grey.shape[0] // 2
    smooth = cv2.GaussianBlur(grey, (0, 0), NAIL_CONTOUR.smoothing_px)
    slope = side * np.gradient(smooth, axis=0)
    reach = max(int(np.ceil(NAIL_CONTOUR.reach_in_widths * width_px)), 2)
    centre = int(np.rint(middle + side * 0.5 * width_px))
    rows = np.arange(max(centre - reach, 1), min(centre + reach + 1, slope.shape[0] - 1))[:: 1 if side > 0.0 else -1]
    steepest = slope[rows].max(axis=0)
    peaks = (slope[rows] >= slope[rows - 1]) & (slope[rows] >= slope[rows + 1])
    peaks &= slope[rows] >= NAIL_CONTOUR.share_of_steepest * steepest
    edge = rows[np.where(peaks.any(axis=0), peaks.argmax(axis=0), slope[rows].argmax(axis=0))]
    column = np.arange(grey.shape[1])
    steps = subpixel_offset(slope[edge - 1, column], slope[edge, column], slope[edge + 1, column])
    return np.asarray(edge - middle + steps, dtype=np.float64)


def _robust_line(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float]:
    """Slope and offset; points that lie off the line (a ball on the edge) are left out step by step."""
    used = np.ones(x.size, dtype=bool)
    slope, offset = 0.0, float(np.median(y))
    for _ in range(NAIL_CONTOUR.rounds):
        residual = y - (offset + slope * x)
        used = inliers(residual, used, NAIL_CONTOUR.outlier_deviations, NAIL_CONTOUR.least_deviation_px)
        slope, offset = (float(v) for v in np.polyfit(x[used], y[used], 1))
    return slope, offset
