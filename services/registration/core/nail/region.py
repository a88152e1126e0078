"""The pixels that take part in the fit, with their rays: a strip along the nail around its holes."""

from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.imaging_chain import Real, Scale, blurred_image
from services.registration.core.nail.occluders import (
    Occluders,
    Penumbra,
    ball_discs_px,
    guide_body_path_mm,
    steel_path_mm,
)
from services.registration.core.nail.rays import (
    LEAST_RAYS_TO_SHARE,
    PixelRays,
    SteelPaths,
    nail_rays,
    pixel_rays,
    rays_of,
)
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform
from shared.two_cores import on_both_halves

Scalar = TypeVar("Scalar", bound=np.generic)

_LEAST_SIDE = 8

_BLUR_REACH_PX = 8
_INSIDE_APERTURE_PX = 9.0
_LEAST_PIXELS = 200
# A ball's shadow may reach so much further than its radius: distortion and the way from the beam's middle stretch it.
_STRETCH, _WIRE_REACH_MM = 0.3, 0.5


@dataclass(frozen=True, slots=True)
class RegionBounds:
    """Part of the nail that is looked at, in the nail's frame: from x to x, and to either side of its axis, in mm."""

    first_x_mm: float
    last_x_mm: float
    half_width_mm: float


def region_bounds(nail: NailPart, surroundings_mm: float) -> RegionBounds:
    """The holes with so many mm of surroundings along and beside the nail, without the rounded tip."""
    first = min(h.axis.point_mm[0] - 0.5 * h.diameter_mm for h in nail.holes)
    last = max(h.axis.point_mm[0] + 0.5 * h.diameter_mm for h in nail.holes)
    before_tip = max(last, nail.tip_x_mm - nail.radius_mm)
    return RegionBounds(
        float(first) - surroundings_mm, float(min(last + surroundings_mm, before_tip)), nail.radius_mm + surroundings_mm
    )


@dataclass(frozen=True, slots=True)
class PixelGrid:
    """Rectangle of the image in pixels of `reduction` squared: its first pixel's corner, and rows and columns."""

    left: int
    top: int
    shape: tuple[int, int]
    reduction: int

    @property
    def origin_px(self) -> tuple[float, float]:
        """Centre of the first reduced pixel."""
        centre = 0.5 * (self.reduction - 1)
        return self.left + centre, self.top + centre

    @property
    def axes_px(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where the reduced pixels' centres are in the image: x of the columns, and y of the rows."""
        rows, columns = (self.reduction * np.arange(count, dtype=np.float64) for count in self.shape)
        return self.origin_px[0] + columns, self.origin_px[1] + rows

    def centres_of(self, places: NDArray[np.int64]) -> NDArray[np.float64]:
        """Centres (x, y) in the image of reduced pixels at flat places, shape (N,): shape (N, 2)."""
        rows, columns = np.divmod(places, self.shape[1])
        x_px, y_px = self.axes_px
        return np.stack([x_px[columns], y_px[rows]], axis=1)

    def blocks_of(self, image: NDArray[Scalar]) -> NDArray[Scalar]:
        """What an image holds, shape (rows, reduction, columns, reduction)."""
        rows, columns = self.shape
        side = self.reduction
        block = image[self.top : self.top + rows * side, self.left : self.left + columns * side]
        return block.reshape(rows, side, columns, side)


def grid_around(
    calibration: CArmCalibration,
    strip: RegionBounds,
    camera_from_nail: Transform[Camera, Nail],
    reduction: int,
    around: int,
) -> PixelGrid | None:
    """The strip's rectangle with so many reduced pixels around it; `None` when hardly any of it is in the image."""
    corners = np.array(
        [(x, y, 0.0) for x in (strip.first_x_mm, strip.last_x_mm) for y in (-strip.half_width_mm, strip.half_width_mm)]
    )
    px = calibration.image_from_camera(camera_from_nail.points(corners))
    margin = around * reduction
    low = np.maximum(np.floor(px.min(axis=0)) - margin, 0.0).astype(int)
    limit = np.array([calibration.width_px, calibration.height_px])
    high = np.minimum(np.ceil(px.max(axis=0)) + margin + 1, limit).astype(int)
    columns, rows = (int(v) for v in (high - low) // reduction)
    if columns < _LEAST_SIDE or rows < _LEAST_SIDE:
        return None
    return PixelGrid(int(low[0]), int(low[1]), (rows, columns), reduction)


@dataclass(frozen=True, slots=True, eq=False)
class FitRegion:
    """A rectangle of (perhaps reduced) pixels, the strip in it that is compared, and all rays that it needs.

    Attributes
    ----------
    scale
        Reduction and smoothing of its pixels.
    shape, origin_px
        Rows and columns of the rectangle, and the place of its first pixel in the image.
    support
        Flat indices into the rectangle where the model is evaluated: the strip and the reach of the blur, shape (S,).
    compared
        Flat indices of the strip, shape (N,), a subset of `support`.
    grey
        Grey values of the whole rectangle divided by `grey_scale`, shape of the rectangle.
    along_mm, across_mm
        Position of the strip's pixels in the nail's plane at the start pose, shape (N,).
    rays
        Of the support's pixels.
    steel
        Paths in balls and wires of the support's pixels.
    delrin_excess_mm
        Path in the guide's body beyond the strip's usual one, mean over the samples of each pixel, on the whole
        rectangle, shape of it, zero off the support: what all of the strip has in common cannot be told from the
        background.
    """

    scale: Scale
    shape: tuple[int, int]
    origin_px: tuple[float, float]
    support: NDArray[np.int64]
    compared: NDArray[np.int64]
    grey: NDArray[np.float64]
    grey_scale: float
    along_mm: NDArray[np.float64]
    across_mm: NDArray[np.float64]
    rays: PixelRays
    steel: SteelPaths
    delrin_excess_mm: NDArray[np.float64]

    def strip(self, picture: NDArray[Real]) -> NDArray[np.float64]:
        """The strip's pixels, shape (N,), of a picture of the whole rectangle."""
        return picture.ravel()[self.compared].astype(np.float64, copy=False)


def cut_region(
    pixels: NDArray[np.float32],
    calibration: CArmCalibration,
    nail: NailPart,
    surroundings_mm: float,
    camera_from_nail: Transform[Camera, Nail],
    occluders: Occluders,
    scale: Scale,
) -> FitRegion | None:
    """Take the strip out of the image; `None` when fewer than 200 of its pixels are inside image and aperture."""
    strip = region_bounds(nail, surroundings_mm)
    grid = grid_around(calibration, strip, camera_from_nail, scale.reduction, _BLUR_REACH_PX + 1)
    if grid is None:
        return None
    slopes = _slopes(calibration, grid)
    along, across = _nail_plane(slopes.reshape(-1, 2), camera_from_nail)
    inside = (along > strip.first_x_mm) & (along < strip.last_x_mm) & (np.abs(across) < strip.half_width_mm)
    inside &= _usable(grid, calibration, occluders).ravel()
    if np.count_nonzero(inside) * grid.reduction**2 < _LEAST_PIXELS:
        return None
    compared = np.flatnonzero(inside)
    support = np.flatnonzero(_dilated(inside.reshape(grid.shape), _BLUR_REACH_PX))
    rays = rays_of(pixel_rays(slopes), support)
    penumbra = Penumbra.beside(calibration, float(camera_from_nail.translation_mm[2]), grid.reduction)
    delrin = _delrin_paths(rays, occluders, penumbra)
    delrin_excess = np.zeros(grid.shape)
    delrin_excess.ravel()[support] = delrin - np.median(delrin[inside[support]])
    steel = _steel_beside(rays, grid.centres_of(support), grid.reduction, occluders, calibration, penumbra)
    grey = grid.blocks_of(pixels).mean(axis=(1, 3), dtype=np.float64)
    if scale.smoothing > 0.0:
        grey = blurred_image(grey, scale.smoothing)
    grey_scale = float(np.percentile(grey.ravel()[compared], 95.0)) or 1.0
    return FitRegion(
        scale,
        grid.shape,
        grid.origin_px,
        support,
        compared,
        grey / grey_scale,
        grey_scale,
        along[compared],
        across[compared],
        rays,
        steel,
        delrin_excess,
    )


def _steel_beside(
    rays: PixelRays,
    centres_px: NDArray[np.float64],
    side_px: int,
    occluders: Occluders,
    calibration: CArmCalibration,
    penumbra: Penumbra,
) -> SteelPaths:
    """Paths in balls and wires; rays far from all are not followed."""
    near = np.zeros(len(centres_px), dtype=bool)
    wires_px = [rod.discs_px(calibration, _WIRE_REACH_MM) for rod in occluders.rods]
    discs_px = np.concatenate([ball_discs_px(occluders, calibration), *wires_px])
    reach_px = discs_px[:, 2:] * (1.0 + _STRETCH) + side_px
    around = (discs_px[:, :2] + reach_px > centres_px.min(axis=0)) & (
        discs_px[:, :2] - reach_px < centres_px.max(axis=0)
    )
    for x, y, radius in np.column_stack([discs_px[:, :2], reach_px])[np.all(around, axis=1)]:
        near |= (centres_px[:, 0] - x) ** 2 + (centres_px[:, 1] - y) ** 2 < radius**2
    places = np.flatnonzero(near)
    path_mm = steel_path_mm(rays_of(rays, places), occluders, calibration, penumbra)
    return SteelPaths.of_pixels(len(centres_px), places, path_mm)


def _usable(grid: PixelGrid, calibration: CArmCalibration, occluders: Occluders) -> NDArray[np.bool_]:
    """Inside the aperture, and not hidden by something of unknown shape; shape (rows, columns)."""
    seen = _in_aperture(calibration, grid)
    if occluders.hidden is not None:
        seen &= ~grid.blocks_of(occluders.hidden).any(axis=(1, 3))
    return seen


def _slopes(calibration: CArmCalibration, grid: PixelGrid) -> NDArray[np.float64]:
    """Directions at z = 1 of the rays through the grid's pixels, shape (rows, columns, 2)."""
    rays = calibration.rays_camera_of_grid(*grid.axes_px)
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


def _in_aperture(calibration: CArmCalibration, grid: PixelGrid) -> NDArray[np.bool_]:
    if calibration.aperture is None:
        return np.ones(grid.shape, dtype=bool)
    x_px, y_px = grid.axes_px
    return calibration.aperture.holds(x_px, y_px[:, None], _INSIDE_APERTURE_PX)


def _dilated(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    square = np.ones((2 * reach + 1,) * 2, np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), square) > 0)


def _delrin_paths(rays: PixelRays, occluders: Occluders, penumbra: Penumbra) -> NDArray[np.float64]:
    """Mean path in the guide's body over a few samples of every pixel, shape (S,), in mm."""
    halves = on_both_halves(
        lambda part: guide_body_path_mm(rays_of(rays, part), occluders, penumbra),
        len(rays.slopes),
        LEAST_RAYS_TO_SHARE,
    )
    return np.concatenate(halves)
