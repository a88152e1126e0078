"""Rays of pixels, and where a ray is in the nail, its cannulation and its bores.

Rays are given by their direction in the camera frame with z = 1, so that `s` along a ray is the depth in mm; lengths
are therefore multiplied by the direction's norm.

A ray crosses the nail over less than 3 mm of its length, along which an arc of 300 mm radius is straight within 0.004
mm. In a bent nail each ray is therefore traced through the straight nail of the cross-section where it passes nearest
to the centre line, or through that of a hole that it may meet. Cross-sections are taken every half millimetre.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.registration.core.tuning import BENT_NAIL
from shared.compiled import compiled_inline
from shared.geometry.bend import places_along
from shared.geometry.frames import Nail
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform

# 16 places, each with its opposite, that have the mean, the variances and all moments up to the fifth degree of a whole
# pixel: any correlation between column and row would blur slanting edges by too much or too little. The first four
# alone stand for a pixel in which they hardly differ; they have its mean and variances.
_FIRST = np.array([(-0.0148, 0.4080), (0.4080, 0.0148)])
_OTHERS = np.array(
    [(-0.3939, -0.4045), (0.1258, 0.0483), (0.2626, 0.2479), (0.2435, -0.4367), (-0.0392, 0.0954), (0.4464, -0.2698)]
)
SAMPLES_PX = np.concatenate([_FIRST, -_FIRST, _OTHERS, -_OTHERS])
FIRST_SAMPLES = 2 * len(_FIRST)

# Fewer are traced sooner than handed to another core.
LEAST_RAYS_TO_SHARE = 1000

# Guards: a ray parallel to a cylinder is inside everywhere or nowhere; small lengths would divide by zero.
PARALLEL, EVERYWHERE = 1e-14, 1e9
LEAST_STEP_MM, _LEAST_ACROSS = 1e-4, 1e-6
# Below this cosine a hole's axis lies along the nail, and the reach of its rims along it has no bound.
_LEAST_COSINE = 0.2
# Rays along a chamfer's surface: below this rate of entering it they are taken not to meet it.
_LEAST_RATE = 0.2

Ray = tuple[float, float, float, float, float, float]
Tube = tuple[float, float, float, float]
# Of a nail with slots a ninth number: half the distance of a slot's two axes. The compiler knows how many there are:
# code for nails without slots has no branch for them, which would cost a fifth of the time of all rays.
Bore = tuple[float, ...]
_SLOT, _DIMENSIONS_WITH_SLOTS = 9, 3
NO_TUBE = (1.0, 0.0, 1.0, 0.0)
# Mean attenuation per mm, its relative variance (hardening), and the least attenuation over the mean.
Material = tuple[float, float, float]


class PixelRays(NamedTuple):
    """Directions (x, y) at z = 1 in the camera's frame, shape (S, 2) each."""

    slopes: NDArray[np.float64]  # through the middle of each pixel
    # Their change from column to column and from row to row
    right: NDArray[np.float64]
    down: NDArray[np.float64]


class SteelPaths(NamedTuple):
    """Paths in steel other than the nail, which few pixels have."""

    row: NDArray[np.int64]  # which row of `path_mm` is each pixel's, -1 where there is none, shape (S,)
    path_mm: NDArray[np.float64]  # at each of the `SAMPLES_PX`, shape (K, samples)

    @staticmethod
    def of_pixels(count: int, places: NDArray[np.int64], path_mm: NDArray[np.float64]) -> "SteelPaths":
        """Of so many pixels those with a path, looked for at some places; paths there have shape (places, samples)."""
        some = np.any(path_mm > 0.0, axis=1)
        row = np.full(count, -1, dtype=np.int64)
        row[places[some]] = np.arange(np.count_nonzero(some))
        return SteelPaths(row, np.ascontiguousarray(path_mm[some]))

    def of(self, part: slice | NDArray[np.int64]) -> "SteelPaths":
        """That of some of the pixels."""
        return SteelPaths(self.row[part], self.path_mm)


def pixel_rays(slopes: NDArray[np.float64]) -> PixelRays:
    """Rays of all pixels, row by row, of a rectangle whose directions have shape (rows, columns, 2)."""
    # differences between neighbours are good enough: distortion is smooth
    down, right = np.gradient(slopes, axis=(0, 1))
    return PixelRays(*(np.ascontiguousarray(a.reshape(-1, 2)) for a in (slopes, right, down)))


def rays_of(rays: PixelRays, part: slice | NDArray[np.int64]) -> PixelRays:
    """Those of some of the pixels."""
    return PixelRays(*(of_all[part] for of_all in rays))


def sample_directions(rays: PixelRays, places_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions at places within each pixel, shape (K, 2); pixel by pixel, shape (S * K, 2)."""
    samples = rays.slopes[:, None] + places_px[:, :1] * rays.right[:, None] + places_px[:, 1:] * rays.down[:, None]
    return np.ascontiguousarray(samples.reshape(-1, 2))


@compiled_inline
def cylinder_interval(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, wx: float, wy: float, wz: float, radius: float
) -> tuple[float, float]:
    """Where the ray o + s d is inside an endless cylinder through the origin along w (unit); empty as (1, 0)."""
    along_d = dx * wx + dy * wy + dz * wz
    along_o = ox * wx + oy * wy + oz * wz
    px, py, pz = dx - along_d * wx, dy - along_d * wy, dz - along_d * wz
    qx, qy, qz = ox - along_o * wx, oy - along_o * wy, oz - along_o * wz
    a = px * px + py * py + pz * pz
    c = qx * qx + qy * qy + qz * qz - radius * radius
    if a < PARALLEL:
        return (-EVERYWHERE, EVERYWHERE) if c < 0.0 else (1.0, 0.0)
    b = px * qx + py * qy + pz * qz
    discriminant = b * b - a * c
    if discriminant <= 0.0:
        return (1.0, 0.0)
    root = np.sqrt(discriminant)
    return ((-b - root) / a, (-b + root) / a)


@compiled_inline
def bore_at(bores: NDArray[np.float64], h: int) -> Bore:
    """One of the bores (see `NailShape`) as plain numbers: references to a view of it would be counted at every use."""
    if bores.ndim == _DIMENSIONS_WITH_SLOTS:
        return (
            bores[0, h, 0],
            bores[0, h, 1],
            bores[0, h, 2],
            bores[0, h, 3],
            bores[0, h, 4],
            bores[0, h, 5],
            bores[0, h, 6],
            bores[0, h, 7],
            bores[0, h, 8],
        )
    return (bores[h, 0], bores[h, 1], bores[h, 2], bores[h, 3], bores[h, 4], bores[h, 5], bores[h, 6], bores[h, 7])


@compiled_inline
def ray_through(cx: float, cy: float, rotation: NDArray[np.float64], translation_mm: NDArray[np.float64]) -> Ray:
    """The ray through (cx, cy, 1) in the nail's frame: a point near the nail, and the direction.

    The point is taken at the nail's depth, which keeps the quadratics' coefficients small.
    """
    depth = translation_mm[2]
    ux, uy = cx * depth - translation_mm[0], cy * depth - translation_mm[1]
    return (
        rotation[0, 0] * ux + rotation[1, 0] * uy,
        rotation[0, 1] * ux + rotation[1, 1] * uy,
        rotation[0, 2] * ux + rotation[1, 2] * uy,
        rotation[0, 0] * cx + rotation[1, 0] * cy + rotation[2, 0],
        rotation[0, 1] * cx + rotation[1, 1] * cy + rotation[2, 1],
        rotation[0, 2] * cx + rotation[1, 2] * cy + rotation[2, 2],
    )


@compiled_inline
def tube_of(ray: Ray, radius_mm: float, inner_mm: float) -> Tube:
    """Where the ray is inside the nail, and where inside its cannulation: near, far, inner near, inner far.

    Both are cylinders about the x axis and share their middle.
    """
    _, oy, oz, _, dy, dz = ray
    across2 = max(dy * dy + dz * dz, PARALLEL)
    middle = -(oy * dy + oz * dz) / across2
    y, z = oy + middle * dy, oz + middle * dz
    impact2 = y * y + z * z
    outer2, inner2 = radius_mm * radius_mm - impact2, inner_mm * inner_mm - impact2
    if outer2 <= 0.0:
        return NO_TUBE
    half = np.sqrt(outer2 / across2)
    if inner2 <= 0.0:
        return middle - half, middle + half, 1.0, 0.0
    inner_half = np.sqrt(inner2 / across2)
    return middle - half, middle + half, middle - inner_half, middle + inner_half


@compiled_inline
def may_touch(ray: Ray, tube: Tube, bore: Bore, radius_mm: float, reach_mm: float) -> bool:
    """Whether a ray comes as near along the nail as a bore reaches that is wider by `reach_mm`.

    Quick, since most rays of a window pass far from all bores, and never wrongly no.
    """
    middle, half = 0.5 * (tube[0] + tube[1]), 0.5 * (tube[1] - tube[0])
    wide_mm = bore[6] + reach_mm
    leaning = abs(bore[3]) / max(np.sqrt(max(1.0 - bore[3] * bore[3], 0.0)), _LEAST_ACROSS)
    along_mm = leaning * (radius_mm + wide_mm + abs(bore[1]) + abs(bore[2]))
    if len(bore) == _SLOT:
        along_mm += bore[8]
    return bool(abs(ray[0] + middle * ray[3] - bore[0]) < wide_mm + along_mm + half * abs(ray[3]))


@compiled_inline
def outline_near(ray: Ray, radius_mm: float, inner_mm: float, reach_mm: float) -> bool:
    """Whether a ray comes nearer than `reach_mm` to the outline of nail or cannulation."""
    _, oy, oz, _, dy, dz = ray
    impact = abs(oz * dy - oy * dz) / np.sqrt(dy * dy + dz * dz)
    return bool(abs(impact - radius_mm) < reach_mm or (inner_mm > 0.0 and abs(impact - inner_mm) < reach_mm))


@compiled_inline
def within(tube: Tube, first: float, last: float) -> float:
    """Length of a stretch of the ray that lies in the tube's metal."""
    near, far, inner_near, inner_far = tube
    in_nail = max(0.0, min(last, far) - max(first, near))
    return in_nail - max(0.0, min(last, inner_far) - max(first, inner_near))


@compiled_inline
def in_bore(ray: Ray, bore: Bore, excess_mm: float) -> tuple[float, float]:
    """Where the ray is inside a bore whose radius is larger by so much; nowhere when nothing is left of it."""
    ox, oy, oz, dx, dy, dz = ray
    qx, qy, qz = ox - bore[0], oy - bore[1], oz - bore[2]
    radius = max(bore[6] + excess_mm, 0.0)
    if len(bore) == _SLOT:
        return _slot_interval(qx, qy, qz, dx, dy, dz, bore, radius)
    return cylinder_interval(qx, qy, qz, dx, dy, dz, bore[3], bore[4], bore[5], radius)


@compiled_inline
def _slot_interval(
    qx: float, qy: float, qz: float, dx: float, dy: float, dz: float, bore: Bore, radius: float
) -> tuple[float, float]:
    """Where the ray q + s d is inside a slot: two half bores and the block between them, which are convex together."""
    ex, ey, ez, half = *_slot_direction(bore), bore[8]
    first, last = EVERYWHERE, -EVERYWHERE
    for end in (-half, half):
        x, y, z = qx - end * ex, qy - end * ey, qz - end * ez
        near, far = cylinder_interval(x, y, z, dx, dy, dz, bore[3], bore[4], bore[5], radius)
        if near < far:
            first, last = min(first, near), max(last, far)
    fx, fy, fz = bore[4] * ez - bore[5] * ey, bore[5] * ex - bore[3] * ez, bore[3] * ey - bore[4] * ex
    near, far = _between(qx * ex + qy * ey + qz * ez, dx * ex + dy * ey + dz * ez, half)
    across_near, across_far = _between(qx * fx + qy * fy + qz * fz, dx * fx + dy * fy + dz * fz, radius)
    near, far = max(near, across_near), min(far, across_far)
    if near < far:
        first, last = min(first, near), max(last, far)
    return (first, last) if first < last else (1.0, 0.0)


@compiled_inline
def _slot_direction(bore: Bore) -> tuple[float, float, float]:
    """Across the bore's axis, along the nail as far as can be; unit."""
    across = max(np.sqrt(1.0 - bore[3] * bore[3]), _LEAST_ACROSS)
    return across, -bore[3] * bore[4] / across, -bore[3] * bore[5] / across


@compiled_inline
def _between(place: float, rate: float, half: float) -> tuple[float, float]:
    """Where place + s rate is less than `half` from zero; empty as (1, 0)."""
    if abs(rate) < PARALLEL:
        return (-EVERYWHERE, EVERYWHERE) if abs(place) < half else (1.0, 0.0)
    middle, reach = -place / rate, half / abs(rate)
    return middle - reach, middle + reach


@compiled_inline
def beside_bore(px: float, py: float, pz: float, bore: Bore) -> tuple[float, float, float, float]:
    """A place from a bore's point: how far along the axis, and the vector across it from the nearest axis of a slot."""
    along = px * bore[3] + py * bore[4] + pz * bore[5]
    gx, gy, gz = px - along * bore[3], py - along * bore[4], pz - along * bore[5]
    if len(bore) == _SLOT:
        ex, ey, ez = _slot_direction(bore)
        end = min(max(gx * ex + gy * ey + gz * ez, -bore[8]), bore[8])
        gx, gy, gz = gx - end * ex, gy - end * ey, gz - end * ez
    return along, gx, gy, gz


@compiled_inline
def cone(ray: Ray, place: float, bore: Bore) -> tuple[float, float, float, float]:
    """How far a point is inside a bore's chamfer (mm, negative outside), and the gradient of that."""
    px, py, pz = ray[0] + place * ray[3] - bore[0], ray[1] + place * ray[4] - bore[1], ray[2] + place * ray[5] - bore[2]
    along, gx, gy, gz = beside_bore(px, py, pz, bore)
    aside = max(np.sqrt(gx * gx + gy * gy + gz * gz), LEAST_STEP_MM)
    side = 1.0 if along > 0.0 else -1.0
    inside = side * along - bore[7] - (aside - bore[6])
    return inside, side * bore[3] - gx / aside, side * bore[4] - gy / aside, side * bore[5] - gz / aside


@compiled_inline
def chamfered(ray: Ray, place: float, inwards: float, bore: Bore) -> float:
    """Length of the ray, in units of its direction, from an end inwards, that a bore's chamfer takes away."""
    inside, gx, gy, gz = cone(ray, place, bore)
    rate = -inwards * (gx * ray[3] + gy * ray[4] + gz * ray[5])
    return max(inside, 0.0) / rate if rate > _LEAST_RATE else 0.0


@compiled_inline
def meets(ray: Ray, tube: Tube, bore: Bore, radius_mm: float, excess_mm: float) -> bool:
    """Whether a ray is in both the nail and a bore or its chamfer, all wider by `excess_mm`, as the tube must be."""
    wide_mm = excess_mm + max(radius_mm - bore[7], 0.0)
    if not may_touch(ray, tube, bore, radius_mm + excess_mm, wide_mm):
        return False
    first, last = in_bore(ray, bore, wide_mm)
    return bool(min(last, tube[1]) > max(first, tube[0]))


@compiled_inline
def bore_and_rim_near(
    ray: Ray, radius_mm: float, inner_mm: float, bores: NDArray[np.float64], reach_mm: float
) -> tuple[bool, bool]:
    """Whether a ray comes nearer than `reach_mm` to a bore, and whether to metal around it, too."""
    tube = tube_of(ray, radius_mm + reach_mm, inner_mm)
    near, rim_near = False, False
    if tube[1] > tube[0]:
        for h in range(bores.shape[-2]):
            bore = bore_at(bores, h)
            if meets(ray, tube, bore, radius_mm, reach_mm):
                near = True
                first, last = in_bore(ray, bore, -reach_mm)
                rim_near = rim_near or first > tube[0] or last < tube[1]
    return near, rim_near


class NailShape(NamedTuple):
    """The nail as the rays meet it."""

    # `camera_from_nail`, shapes (3, 3) and (3,)
    rotation: NDArray[np.float64]
    translation_mm: NDArray[np.float64]
    # Of the nail and of the canal along it (0: solid)
    radius_mm: float
    cannulation_radius_mm: float
    # Per hole: point, unit direction, radius, and distance from the point beyond which the bore widens by as much as it
    # goes on (its chamfer), in the nail's frame, shape (H, 8). Of a nail with slots also half the distance of a slot's
    # two axes, 0 of a bore, shape (1, H, 9). Bores must not cross one another.
    bores: NDArray[np.float64]
    material: Material  # of the nail
    steel_in_nail_material: float  # how many mm of the nail's material attenuate as 1 mm of steel does


def section_places(
    nail: NailPart, curvature_per_m: tuple[float, float], rays: PixelRays, shape: NailShape
) -> NDArray[np.float64]:
    """Arc lengths of the cross-sections in which rays are traced, shape (S,)."""
    spot_mm = -shape.rotation.T @ shape.translation_mm
    directions = np.column_stack([rays.slopes, np.ones(len(rays.slopes))]) @ shape.rotation
    place = places_along(spot_mm, directions, curvature_per_m)
    step_mm = BENT_NAIL.section_step_mm
    chosen, nearest = np.round(place / step_mm) * step_mm, np.full(len(place), np.inf)
    for hole in nail.all_holes:
        x_mm, lean = float(hole.axis.point_mm[0]), abs(float(hole.axis.direction[0]))
        cosine = max(np.sqrt(1.0 - lean * lean), _LEAST_COSINE)
        reach_mm = (hole.half_length_mm + nail.radius_mm * lean) / cosine + BENT_NAIL.about_hole_mm
        away = np.abs(place - x_mm)
        here = (away < reach_mm) & (away < nearest)
        chosen[here], nearest[here] = x_mm, away[here]
    return np.asarray(chosen)


def sections_of(along_mm: NDArray[np.float64], part: slice) -> Iterator[slice]:
    """Stretches of equal values within a part of a sorted array."""
    ends = part.start + 1 + np.flatnonzero(np.diff(along_mm[part]))
    edges = [part.start, *ends.tolist(), part.stop]
    for first, last in pairwise(edges):
        if last > first:
            yield slice(first, last)


def section_shape(shape: NailShape, nail_from_section: Transform[Nail, Nail], x_mm: float) -> NailShape:
    """The straight nail that continues a cross-section, in the frame of that."""
    bores = shape.bores.copy()
    bores[..., 0] -= x_mm
    return shape._replace(
        rotation=np.ascontiguousarray(shape.rotation @ nail_from_section.rotation),
        translation_mm=shape.rotation @ nail_from_section.translation_mm + shape.translation_mm,
        bores=bores,
    )
