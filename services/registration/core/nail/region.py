"""The pixels that are compared, with their rays: a region along the nail around its holes."""

from dataclasses import dataclass, replace
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.imaging_chain import Real, Sampling, blurred_image
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
    pixel_rays,
    rays_of,
)
from services.registration.core.tuning import FIT_REGION
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import Hole, NailPart, across_holes, place_of_hole
from shared.geometry.transform import Transform
from shared.two_cores import on_both_halves
from shared.xray.pixel_scale import pixels as pixels_of

Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True, slots=True, eq=False)
class FitInput:
    """What a fit of the nail is given."""

    pixels: NDArray[np.float32]  # grey values of the un-mirrored image, darker is denser, shape (height, width)
    calibration: CArmCalibration
    nail: NailPart
    occluders: Occluders
    objects_left_out: bool = False  # whether pixels are hidden because they are darker than an earlier fit

    def hiding(self, more: NDArray[np.bool_]) -> "FitInput":
        """Input with more pixels hidden, shape of the image."""
        hidden = self.occluders.hidden
        return replace(self, occluders=replace(self.occluders, hidden=more if hidden is None else hidden | more))

    def without_objects(self, foreign: NDArray[np.bool_]) -> "FitInput | None":
        """Input without these pixels of objects, shape of the image; None where all were hidden before."""
        hidden = self.occluders.hidden
        more = bool(np.any(foreign if hidden is None else foreign & ~hidden))
        return replace(self.hiding(foreign), objects_left_out=True) if more else None


@dataclass(frozen=True, slots=True, eq=False)
class RegionBounds:
    """Part of the nail's plane that is compared: from x to x, and to either side of the nail's axis, in mm."""

    first_x_mm: float
    last_x_mm: float
    half_width_mm: float
    across: NDArray[np.float64]  # direction to the side, across the holes, shape (3,)


def region_bounds(nail: NailPart, surroundings_mm: float) -> RegionBounds:
    """The holes with so many mm of surroundings along and beside the nail, without the rounded tip."""
    lean_mm = {h.id: nail.radius_mm * abs(h.axis.direction[0]) / h.cosine_across_nail for h in nail.holes}
    first = min(h.axis.point_mm[0] - h.half_length_mm - lean_mm[h.id] for h in nail.holes)
    last = max(h.axis.point_mm[0] + h.half_length_mm + lean_mm[h.id] for h in nail.holes)
    before_tip = max(last, nail.tip_x_mm - nail.radius_mm)
    last_mm = float(min(last + surroundings_mm, before_tip))
    return RegionBounds(
        float(first) - surroundings_mm, last_mm, nail.radius_mm + surroundings_mm, across_holes(nail)[1]
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
        """The rectangle of an image, shape (rows, reduction, columns, reduction)."""
        rows, columns = self.shape
        side = self.reduction
        block = image[self.top : self.top + rows * side, self.left : self.left + columns * side]
        return block.reshape(rows, side, columns, side)


def grid_around(
    calibration: CArmCalibration,
    bounds: RegionBounds,
    camera_from_nail: Transform[Camera, Nail],
    reduction: int,
    margin_px: int,
) -> PixelGrid | None:
    """Rectangle of the bounds with a margin of reduced pixels; `None` when hardly any of it is in the image."""
    sides_mm, x_axis = (-bounds.half_width_mm, bounds.half_width_mm), np.array([1.0, 0.0, 0.0])
    ends_mm = (bounds.first_x_mm, bounds.last_x_mm)
    corners = np.array([x * x_axis + side * bounds.across for x in ends_mm for side in sides_mm])
    px = calibration.image_from_camera(camera_from_nail.points(corners))
    margin = margin_px * reduction
    low = np.maximum(np.floor(px.min(axis=0)) - margin, 0.0).astype(int)
    limit = np.array([calibration.width_px, calibration.height_px])
    high = np.minimum(np.ceil(px.max(axis=0)) + margin + 1, limit).astype(int)
    columns, rows = (int(v) for v in (high - low) // reduction)
    if min(columns, rows) < FIT_REGION.least_side_px:
        return None
    return PixelGrid(int(low[0]), int(low[1]), (rows, columns), reduction)


@dataclass(frozen=True, slots=True, eq=False)
class FitRegion:
    """A rectangle of (perhaps reduced) pixels, those of them that are compared, and all rays that these need."""

    sampling: Sampling  # reduction and smoothing of its pixels
    # Rows and columns of the rectangle, and the place of its first pixel in the image
    shape: tuple[int, int]
    origin_px: tuple[float, float]
    # Flat indices into the rectangle where rays are traced: compared pixels and reach of the blur, shape (S,)
    support: NDArray[np.int64]
    compared: NDArray[np.int64]  # flat indices of the compared pixels, shape (N,), a subset of `support`
    grey: NDArray[np.float64]  # grey values of the whole rectangle over its brightness, shape of the rectangle
    # Position of the compared pixels in the nail's plane at the start pose, shape (N,)
    along_mm: NDArray[np.float64]
    across_mm: NDArray[np.float64]
    rays: PixelRays  # of the support's pixels
    steel: SteelPaths  # paths in balls and wires of the support's pixels
    hidden: NDArray[np.bool_]  # pixels that are left out although they lie inside, shape of the rectangle
    # Path in the guide's body beyond the region's median one, mean over the samples of each pixel, zero off the
    # support, shape of the rectangle: what all pixels have in common belongs to the background
    delrin_excess_mm: NDArray[np.float64]

    def compared_values(self, image: NDArray[Real]) -> NDArray[np.float64]:
        """The compared pixels, shape (N,), of an image of the whole rectangle."""
        return image.ravel()[self.compared].astype(np.float64, copy=False)

    def compared_in(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The compared pixels, shape (N,), of a mask of the whole image."""
        left, top = (int(v) for v in self.origin_px)
        return mask[top : top + self.shape[0], left : left + self.shape[1]].ravel()[self.compared]

    def smoothed(self, values: NDArray[np.float64], blur_px: float) -> NDArray[np.float64]:
        """Values of the compared pixels, shape (N,), zero around them, after a Gaussian; shape of the rectangle."""
        image = np.zeros(self.shape)
        image.ravel()[self.compared] = values
        return blurred_image(image, blur_px)

    def about_hole(self, nail: NailPart, hole: Hole, sectors: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Distance of the compared pixels from a hole's middle in hole radii, and which of so many sectors, (N,).

        The distance is that from the middle line of a slot; its sectors have equal lengths of the rim.
        """
        x_mm, y_mm = place_of_hole(nail, hole)
        dx, dy = self.along_mm - x_mm, self.across_mm - y_mm
        beyond, radius_mm, half_mm = hole.beyond_slot(dx), 0.5 * hole.diameter_mm, hole.half_slot_mm
        along_rim_mm = radius_mm * np.arctan2(np.abs(dy), beyond) + half_mm - (dx - beyond)
        rim_mm = 2.0 * np.pi * radius_mm + 4.0 * half_mm
        sector = np.floor((np.copysign(along_rim_mm, dy) / rim_mm + 0.5) * sectors).astype(np.int64)
        return np.asarray(np.hypot(beyond, dy) / radius_mm), sector % sectors

    def on_rectangle(self, values: NDArray[Real], elsewhere: float) -> NDArray[Real]:
        """Values of the support's pixels, shape (S,), on the whole rectangle, shape of it."""
        image = np.full(self.shape, elsewhere, dtype=values.dtype)
        image.ravel()[self.support] = values
        return image


def cut_region(
    fit_input: FitInput, camera_from_nail: Transform[Camera, Nail], surroundings_mm: float, sampling: Sampling
) -> FitRegion | None:
    """Cut the holes and their surroundings out of the image; `None` when fewer than 200 pixels are visible."""
    calibration, occluders = fit_input.calibration, fit_input.occluders
    bounds = region_bounds(fit_input.nail, surroundings_mm)
    reach_px = FIT_REGION.blur_reach_px
    grid = grid_around(calibration, bounds, camera_from_nail, sampling.reduction, reach_px + 1)
    if grid is None:
        return None
    rays_camera = calibration.rays_camera_of_grid(*grid.axes_px)
    slopes = rays_camera[..., :2] / rays_camera[..., 2:]
    along, across = nail_plane(slopes.reshape(-1, 2), camera_from_nail)
    inside = (along > bounds.first_x_mm) & (along < bounds.last_x_mm) & (np.abs(across) < bounds.half_width_mm)
    hidden = _hidden(grid, occluders)
    inside &= (_in_aperture(grid, calibration) & ~hidden).ravel()
    if np.count_nonzero(inside) * grid.reduction**2 < FIT_REGION.least_pixels:
        return None
    compared = np.flatnonzero(inside)
    square = np.ones((2 * reach_px + 1,) * 2, np.uint8)
    support = np.flatnonzero(cv2.dilate(inside.reshape(grid.shape).astype(np.uint8), square))
    rays = rays_of(pixel_rays(slopes), support)
    penumbra = Penumbra.beside(calibration, float(camera_from_nail.translation_mm[2]), grid.reduction)
    halves = on_both_halves(
        lambda part: guide_body_path_mm(rays_of(rays, part), occluders, penumbra), len(support), LEAST_RAYS_TO_SHARE
    )
    delrin = np.concatenate(halves)
    delrin_excess = np.zeros(grid.shape)
    delrin_excess.ravel()[support] = delrin - np.median(delrin[inside[support]])
    grey = grid.blocks_of(fit_input.pixels).mean(axis=(1, 3), dtype=np.float64)
    if sampling.smoothing_px > 0.0:
        grey = blurred_image(grey, sampling.smoothing_px)
    brightness = float(np.percentile(grey.ravel()[compared], FIT_REGION.white_percentile)) or 1.0
    return FitRegion(
        sampling=sampling,
        shape=grid.shape,
        origin_px=grid.origin_px,
        support=support,
        compared=compared,
        grey=grey / brightness,
        along_mm=along[compared],
        across_mm=across[compared],
        rays=rays,
        steel=_steel_beside(rays, grid.centres_of(support), grid.reduction, occluders, calibration, penumbra),
        hidden=hidden,
        delrin_excess_mm=delrin_excess,
    )


def _steel_beside(
    rays: PixelRays,
    centres_px: NDArray[np.float64],
    side_px: int,
    occluders: Occluders,
    calibration: CArmCalibration,
    penumbra: Penumbra,
) -> SteelPaths:
    """Paths in balls and wires; rays far from all of them are not traced."""
    near = np.zeros(len(centres_px), dtype=bool)
    wires_px = [rod.discs_px(calibration, FIT_REGION.wire_reach_mm) for rod in occluders.rods]
    discs_px = np.concatenate([ball_discs_px(occluders, calibration), *wires_px])
    reach_px = discs_px[:, 2:] * (1.0 + FIT_REGION.shadow_stretch) + side_px
    around = (discs_px[:, :2] + reach_px > centres_px.min(axis=0)) & (
        discs_px[:, :2] - reach_px < centres_px.max(axis=0)
    )
    for x, y, radius in np.column_stack([discs_px[:, :2], reach_px])[np.all(around, axis=1)]:
        near |= (centres_px[:, 0] - x) ** 2 + (centres_px[:, 1] - y) ** 2 < radius**2
    places = np.flatnonzero(near)
    path_mm = steel_path_mm(rays_of(rays, places), occluders, calibration, penumbra)
    return SteelPaths.of_pixels(len(centres_px), places, path_mm)


def _in_aperture(grid: PixelGrid, calibration: CArmCalibration) -> NDArray[np.bool_]:
    """Inside the aperture with a margin, shape (rows, columns)."""
    if calibration.aperture is None:
        return np.ones(grid.shape, dtype=bool)
    x_px, y_px = grid.axes_px
    margin_px = pixels_of(FIT_REGION.aperture_margin_detector_mm, calibration.pixel_mm)
    return calibration.aperture.holds(x_px, y_px[:, None], margin_px)


def _hidden(grid: PixelGrid, occluders: Occluders) -> NDArray[np.bool_]:
    """Covered by something of unknown shape, or clipped; shape (rows, columns)."""
    if occluders.hidden is None:
        return np.zeros(grid.shape, dtype=bool)
    return np.asarray(grid.blocks_of(occluders.hidden).any(axis=(1, 3)))


def nail_plane(
    slopes: NDArray[np.float64], camera_from_nail: Transform[Camera, Nail]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where rays meet the plane through the nail's axis that faces the focal spot: x and y in mm, shape (N,) each."""
    nail_from_camera = camera_from_nail.inverse()
    spot = nail_from_camera.translation_mm
    directions = nail_from_camera.directions(np.column_stack([slopes, np.ones(len(slopes))]))
    normal = np.array([0.0, *(-spot[1:] / np.linalg.norm(spot[1:]))])
    depth = -(spot @ normal) / (directions @ normal)
    where = spot + depth[:, None] * directions
    return where[:, 0], where @ np.cross(normal, [1.0, 0.0, 0.0])
