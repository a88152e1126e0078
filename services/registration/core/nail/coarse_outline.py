"""Measure the outline of a hole's opening in the image as received, and fit an ellipse to it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from shared.geometry.calibration import CArmCalibration
from shared.geometry.lines import read_only

_DIRECTIONS = 96
_STEP_PX = 0.5
# How far from the centre the outline is looked for.
_REACH_IN_RADII = 1.45
_BLUR_REACH_PX = 6
_ROUNDS = 6
_LOWEST_POINTS = 16
_TOLERANCE_PX = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Ellipse:
    """An ellipse in an image.

    Attributes
    ----------
    centre_px
        Shape (2,).
    semi_axes_px
        Major, then minor.
    major_axis_rad
        Direction of the major axis, from +x to +y.
    """

    centre_px: NDArray[np.float64]
    semi_axes_px: tuple[float, float]
    major_axis_rad: float

    @property
    def aspect_ratio(self) -> float:
        """Minor over major axis, at most 1: the paper's measure of a hole's circularity."""
        return self.semi_axes_px[1] / self.semi_axes_px[0]

    def signed_distance_px(self, points_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """First-order distance of points, shape (N, 2), from the outline; positive outside, shape (N,)."""
        turn = np.array([np.cos(self.major_axis_rad), np.sin(self.major_axis_rad)])
        offset = points_px - self.centre_px
        along, across = offset @ turn, offset @ np.array([-turn[1], turn[0]])
        a, b = self.semi_axes_px
        level = np.hypot(along / a, across / b)
        slope = np.hypot(along / a**2, across / b**2) / np.maximum(level, 1e-9)
        return np.asarray((level - 1.0) / np.maximum(slope, 1e-9))


@dataclass(frozen=True, slots=True, eq=False)
class Opening:
    """The visible opening of one nail hole.

    Attributes
    ----------
    hole_id
        Name of the hole in the nail's file.
    outline_px
        Points of the outline in measured pixels, those that the ellipse explains, shape (M, 2).
    ellipse
        Fitted in ideal pixels, where perspective is undistorted.
    seen_fraction
        Part of the directions from the centre in which the outline was found (the rest is covered or blurred away).
    """

    hole_id: str
    outline_px: NDArray[np.float64]
    ellipse: Ellipse
    seen_fraction: float


def measure_opening(
    pixels: NDArray[np.generic],
    calibration: CArmCalibration,
    hole_id: str,
    centre_px: NDArray[np.float64],
    radius_px: float,
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
        Radius that the hole would have if seen along its axis.
    """
    grey, corner_px = _surroundings(pixels, centre_px, radius_px)
    centre = centre_px
    for _ in range(2):
        points = _crossings(grey, centre - corner_px, radius_px) + corner_px
        if len(points) < _LOWEST_POINTS:
            return None
        centre = np.asarray(0.5 * (np.percentile(points, 4, axis=0) + np.percentile(points, 96, axis=0)))
    ideal = calibration.distortion.undistort(points)
    fitted = _fit_without_covered(ideal, radius_px)
    if fitted is None:
        return None
    ellipse, used = fitted
    return Opening(hole_id, read_only(points[used]), ellipse, float(np.count_nonzero(used)) / _DIRECTIONS)


def _surroundings(
    pixels: NDArray[np.generic], centre_px: NDArray[np.float64], radius_px: float
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Smoothed grey values wherever the outline is looked for, and the place of their first pixel, shape (2,)."""
    reach = int(np.ceil(2.0 * _REACH_IN_RADII * radius_px)) + _BLUR_REACH_PX
    limit = np.array(pixels.shape[::-1])
    low = np.clip(np.rint(centre_px).astype(int) - reach, 0, limit - 1)
    high = np.clip(np.rint(centre_px).astype(int) + reach + 1, low + 1, limit)
    block = pixels[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    return np.asarray(cv2.GaussianBlur(block, (0, 0), 1.0), dtype=np.float32), low.astype(np.float64)


def _crossings(grey: NDArray[np.float32], centre_px: NDArray[np.float64], radius_px: float) -> NDArray[np.float64]:
    """Points, shape (M, 2), where the grey value falls through the middle level on rays from the centre."""
    angles = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False)
    distances = np.arange(0.0, _REACH_IN_RADII * radius_px, _STEP_PX)
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    where = (centre_px + rays[:, None, :] * distances[None, :, None]).astype(np.float32)
    profile = cv2.remap(grey, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    bright = float(np.percentile(profile[:, distances < 0.55 * radius_px], 70))
    # Along the band the metal reaches far, across it the band's edge is near: the darkest quarter is metal.
    dark = float(np.percentile(profile[:, distances > 1.15 * radius_px], 25))
    below = profile < 0.5 * (bright + dark)
    # Outermost crossing: nothing bright may follow within the band, and a ball inside the opening does not count.
    inner = distances[None, :] < 1.3 * radius_px
    last_bright = distances.size - 1 - np.argmax((~below & inner)[:, ::-1], axis=1)
    found = (~below & inner).any(axis=1) & (last_bright < np.count_nonzero(inner[0]) - 1)
    row, column = np.flatnonzero(found), last_bright[found]
    here, after = profile[row, column], profile[row, column + 1]
    fraction = (here - 0.5 * (bright + dark)) / np.maximum(here - after, 1e-9)
    distance = (column + np.clip(fraction, 0.0, 1.0)) * _STEP_PX
    return np.asarray(centre_px + rays[row] * distance[:, None])


def _fit_without_covered(points_px: NDArray[np.float64], radius_px: float) -> tuple[Ellipse, NDArray[np.bool_]] | None:
    """Fit, leave out points off the outline, fit again: first those far inside, where a ball covers it."""
    used = np.ones(len(points_px), dtype=bool)
    ellipse: Ellipse | None = None
    for attempt in range(_ROUNDS):
        if np.count_nonzero(used) < _LOWEST_POINTS:
            return None
        ellipse = fit_ellipse(points_px[used])
        if ellipse is None or not 0.35 * radius_px < ellipse.semi_axes_px[0] < 1.5 * radius_px:
            return None
        residual = ellipse.signed_distance_px(points_px)
        residual = residual - np.median(residual[used])
        tolerance = max(_TOLERANCE_PX, (3.0 - 0.4 * attempt) * 1.48 * float(np.median(np.abs(residual[used]))))
        used = (residual > -tolerance) & (residual < 1.5 * tolerance)
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
