"""The pixels that take part in the fit, with their rays: a strip along the nail around its holes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.occluders import Occluders, delrin_path_mm, steel_path_mm
from services.registration.core.nail.paths import nail_rays
from services.registration.core.nail.blur import blurred_image
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform

# Rotated-grid samples within a pixel: every sample has its own row and column, so that an edge along
# either axis is resolved to a quarter of a pixel by four samples.
SAMPLES_PX = np.array([[-0.125, -0.375], [0.375, -0.125], [0.125, 0.375], [-0.375, 0.125]])
_SAMPLES = len(SAMPLES_PX)
_BLUR_REACH_PX = 8
_INSIDE_APERTURE_PX = 9.0
_LEAST_PIXELS = 200


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A rectangle of (perhaps reduced) pixels, the strip in it that is compared, and all rays that it needs.

    Attributes
    ----------
    reduction
        Side of a pixel of the window in image pixels.
    smoothing
        Gaussian that the reduced image was smoothed with, in pixels of the window: keeps the likelihood's surface
        smooth, so that coarse fits find their optimum in few steps.
    shape
        Rows and columns of the rectangle.
    support
        Flat indices into the rectangle where the model is evaluated: the strip and the reach of the blur, shape (S,).
    compared
        Flat indices of the strip, shape (N,), a subset of `support`.
    grey
        Grey values of the whole rectangle divided by `grey_scale`, shape of the rectangle.
    along_mm, across_mm
        Position of the strip's pixels in the nail's plane at the start pose, shape (N,).
    directions
        Ray directions (x, y) at z = 1 of all samples of the support, shape (S * samples, 2).
    steel_mm
        Path of those rays in steel balls, shape (S * samples,).
    delrin_mm
        Path in the guide's body, mean over the samples of each pixel, on the whole rectangle, shape of it.
    """

    reduction: int
    smoothing: float
    shape: tuple[int, int]
    origin_px: tuple[float, float]
    support: NDArray[np.int64]
    compared: NDArray[np.int64]
    grey: NDArray[np.float64]
    grey_scale: float
    along_mm: NDArray[np.float64]
    across_mm: NDArray[np.float64]
    directions: NDArray[np.float64]
    steel_mm: NDArray[np.float64]
    delrin_mm: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Scale:
    """How coarsely to look: side of a reduced pixel in image pixels, and smoothing after the reduction, in its pixels."""

    reduction: int
    smoothing: float


@dataclass(frozen=True, slots=True)
class Strip:
    """Part of the nail that is looked at, in the nail's frame: from x to x, and to either side of its axis, in mm."""

    first_x_mm: float
    last_x_mm: float
    half_width_mm: float


def strip_of(nail: NailPart, surroundings_mm: float) -> Strip:
    """The holes with so many mm of surroundings along and beside the nail, without the rounded tip."""
    first = min(h.axis.point_mm[0] - 0.5 * h.diameter_mm for h in nail.holes)
    last = max(h.axis.point_mm[0] + 0.5 * h.diameter_mm for h in nail.holes)
    before_tip = max(last, nail.tip_x_mm - nail.radius_mm)
    return Strip(
        float(first) - surroundings_mm, float(min(last + surroundings_mm, before_tip)), nail.radius_mm + surroundings_mm
    )


def cut_window(
    pixels: NDArray[np.float32],
    calibration: CArmCalibration,
    strip: Strip,
    camera_from_nail: Transform[Camera, Nail],
    occluders: Occluders,
    scale: Scale,
) -> Window | None:
    """Take the strip out of the image; `None` when fewer than 200 of its pixels are inside image and aperture."""
    reduction = scale.reduction
    box = _bounding_box(calibration, strip, camera_from_nail, reduction)
    if box is None:
        return None
    left, top, columns, rows = box
    block = pixels[top : top + rows * reduction, left : left + columns * reduction]
    grey = block.astype(np.float64).reshape(rows, reduction, columns, reduction).mean(axis=(1, 3))
    middle = 0.5 * (reduction - 1)
    x, y = np.meshgrid(left + middle + reduction * np.arange(columns), top + middle + reduction * np.arange(rows))
    centres_px = np.stack([x, y], axis=-1)
    slopes = _slopes(calibration, centres_px)
    along, across = _nail_plane(slopes.reshape(-1, 2), camera_from_nail)
    inside = (along > strip.first_x_mm) & (along < strip.last_x_mm) & (np.abs(across) < strip.half_width_mm)
    inside &= _in_aperture(calibration, centres_px).ravel()
    if np.count_nonzero(inside) * reduction**2 < _LEAST_PIXELS:
        return None
    support = np.flatnonzero(_dilated(inside.reshape(rows, columns), _BLUR_REACH_PX))
    compared = np.flatnonzero(inside)
    samples = _sample_directions(slopes, support)
    delrin = _delrin_map(slopes, occluders)
    if scale.smoothing > 0.0:
        grey = blurred_image(grey, scale.smoothing)
    grey_scale = float(np.percentile(grey.ravel()[compared], 95.0)) or 1.0
    return Window(
        reduction,
        scale.smoothing,
        (rows, columns),
        (left + middle, top + middle),
        support,
        compared,
        grey / grey_scale,
        grey_scale,
        along[compared],
        across[compared],
        samples,
        steel_path_mm(samples, occluders, calibration),
        delrin,
    )


def _bounding_box(
    calibration: CArmCalibration, strip: Strip, camera_from_nail: Transform[Camera, Nail], reduction: int
) -> tuple[int, int, int, int] | None:
    corners = np.array(
        [
            (x, y, 0.0)
            for x in (strip.first_x_mm, strip.last_x_mm)
            for y in (-strip.half_width_mm, strip.half_width_mm)
        ]
    )
    px = calibration.image_from_camera(camera_from_nail.points(corners))
    margin = (_BLUR_REACH_PX + 1) * reduction
    low = np.maximum(np.floor(px.min(axis=0)) - margin, 0.0).astype(int)
    limit = np.array([calibration.width_px, calibration.height_px])
    high = np.minimum(np.ceil(px.max(axis=0)) + margin + 1, limit).astype(int)
    columns, rows = (int(v) for v in (high - low) // reduction)
    if columns < 8 or rows < 8:
        return None
    return int(low[0]), int(low[1]), columns, rows


def _slopes(calibration: CArmCalibration, centres_px: NDArray[np.float64]) -> NDArray[np.float64]:
    rays = calibration.rays_camera(centres_px)
    return np.asarray(rays[..., :2] / rays[..., 2:])


def _nail_plane(
    slopes: NDArray[np.float64], camera_from_nail: Transform[Camera, Nail]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where rays meet the plane through the nail's axis that faces the focal spot: x and y in mm, shape (N,) each."""
    spot, directions = nail_rays(slopes, camera_from_nail)
    normal = np.array([0.0, *(-spot[1:] / np.linalg.norm(spot[1:]))])
    depth = -(spot @ normal) / (directions @ normal)
    where = spot + depth[:, None] * directions
    return where[:, 0], where @ np.cross(normal, [1.0, 0.0, 0.0])


def _in_aperture(calibration: CArmCalibration, centres_px: NDArray[np.float64]) -> NDArray[np.bool_]:
    aperture = calibration.aperture
    if aperture is None:
        return np.ones(centres_px.shape[:-1], dtype=bool)
    distance = np.linalg.norm(centres_px - np.asarray(aperture.centre_px), axis=-1)
    return np.asarray(distance < aperture.radius_px - _INSIDE_APERTURE_PX)


def _dilated(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    grown = mask.copy()
    for axis in (0, 1):
        source = grown.copy()
        for shift in range(1, reach + 1):
            forward, backward = np.zeros_like(source), np.zeros_like(source)
            if axis == 0:
                forward[shift:], backward[:-shift] = source[:-shift], source[shift:]
            else:
                forward[:, shift:], backward[:, :-shift] = source[:, :-shift], source[:, shift:]
            grown |= forward | backward
    return grown


def _sample_directions(slopes: NDArray[np.float64], support: NDArray[np.int64]) -> NDArray[np.float64]:
    """Directions at the sub-pixel samples, by the slopes' own gradient (distortion is smooth), shape (S * samples, 2)."""
    down, right = np.gradient(slopes, axis=(0, 1))
    flat, down, right = (a.reshape(-1, 2)[support] for a in (slopes, down, right))
    samples = flat[:, None] + SAMPLES_PX[:, :1] * right[:, None] + SAMPLES_PX[:, 1:] * down[:, None]
    return np.ascontiguousarray(samples.reshape(-1, 2))


def _delrin_map(slopes: NDArray[np.float64], occluders: Occluders) -> NDArray[np.float64]:
    everywhere = np.arange(slopes.shape[0] * slopes.shape[1])
    path = delrin_path_mm(_sample_directions(slopes, everywhere), occluders)
    return np.asarray(path.reshape(*slopes.shape[:2], _SAMPLES).mean(axis=-1))
