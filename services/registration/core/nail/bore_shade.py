"""What passes along a ray that a bore touches: a mean over the bore's radius, and how it changes.

A path's end on a surface moves along the ray by (g . v) / (g . d) when the surface moves by v, with its normal g and
the ray's direction d. Along a bore's wall that has no bound; there the derivative by the radius is a difference, and
the wall's motion along its normal is a change of radius.
"""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.compiled import compiled
from services.registration.core.nail.ray_geometry import Bore, Ray, Tube, chamfered, cone, in_bore, within
from services.registration.core.nail.shade import (
    CHAMFER,
    HOLE_RADIUS,
    NAIL_RADIUS,
    Material,
    Shade,
    add_motion,
    mean_shade,
    shade_behind,
)

_LEAST_INCIDENCE = 0.002


@compiled
def _add_end(ray: Ray, place: float, share: float, slope: NDArray[np.float32]) -> float:
    """Add the motion of a path's end on the nail or its cannulation; returns the share that the radius has."""
    ox, oy, oz, dx, dy, dz = ray
    x, y, z = ox + place * dx, oy + place * dy, oz + place * dz
    norm = np.sqrt(y * y + z * z)
    share /= max(abs(y * dy + z * dz) / norm, _LEAST_INCIDENCE)
    add_motion(x, y, z, 0.0, y / norm, z / norm, share, slope)
    return share


@compiled
def _add_cone_end(
    ray: Ray, place: float, inwards: float, bore: Bore, weight: float, slope: NDArray[np.float32]
) -> None:
    """Add the motion of a path's end on a bore's chamfer; `weight` is the derivative of what passes by the length."""
    _, gx, gy, gz = cone(ray, place, bore)
    share = weight / (-inwards * (gx * ray[3] + gy * ray[4] + gz * ray[5]))
    x, y, z = ray[0] + place * ray[3], ray[1] + place * ray[4], ray[2] + place * ray[5]
    add_motion(x, y, z, gx, gy, gz, share, slope)
    slope[HOLE_RADIUS] -= share
    slope[CHAMFER] -= share
    slope[NAIL_RADIUS] += share


@compiled
def _add_wall(
    ray: Ray, tube: Tube, bore: Bore, first: float, last: float, share: float, slope: NDArray[np.float32]
) -> None:
    """Add the motion of a bore's wall along a stretch of the ray, as the middle of the stretch sees it."""
    middle = 0.5 * (max(first, tube[0]) + min(last, tube[1]))
    x, y, z = ray[0] + middle * ray[3], ray[1] + middle * ray[4], ray[2] + middle * ray[5]
    px, py, pz = x - bore[0], y - bore[1], z - bore[2]
    along = px * bore[3] + py * bore[4] + pz * bore[5]
    gx, gy, gz = px - along * bore[3], py - along * bore[4], pz - along * bore[5]
    norm = np.sqrt(gx * gx + gy * gy + gz * gz)
    add_motion(x, y, z, gx / norm, gy / norm, gz / norm, share, slope)


@compiled
def _behind_bore(
    ray: Ray,
    tube: Tube,
    bore: Bore,
    bored: tuple[float, float],
    weight: float,
    unit_mm: float,
    steel_mm: float,
    material: Material,
    slope: NDArray[np.float32],
) -> Shade:
    """Shade of a ray that is in a bore between two places; derivatives by the other ends are added, times `weight`."""
    near, far, inner_near, inner_far = tube
    empty = bored[1] <= bored[0]
    metal = within(tube, near, far) - (0.0 if empty else within(tube, bored[0], bored[1]))
    near_free, far_free = empty or not bored[0] < near < bored[1], empty or not bored[0] < far < bored[1]
    near_cut = chamfered(ray, near, 1.0, bore) if near_free else 0.0
    far_cut = chamfered(ray, far, -1.0, bore) if far_free else 0.0
    # where the chamfer meets the bore, no end is left between them
    if not empty and near_free and bored[1] > near and near_cut >= bored[0] - near:
        near_cut, near_free = bored[0] - near, False
    if not empty and far_free and bored[0] < far and far_cut >= far - bored[1]:
        far_cut, far_free = far - bored[1], False
    metal = metal - near_cut - far_cut
    path_mm = unit_mm * max(metal, 0.0) + steel_mm
    shade = shade_behind(path_mm, material)
    if metal <= 0.0 or shade[1] == 0.0:
        return shade
    share = weight * shade[1] / path_mm * unit_mm
    if near_free and near_cut > 0.0:
        _add_cone_end(ray, near + near_cut, 1.0, bore, share, slope)
    elif near_free:
        slope[NAIL_RADIUS] += _add_end(ray, near, share, slope)
    if far_free and far_cut > 0.0:
        _add_cone_end(ray, far - far_cut, -1.0, bore, share, slope)
    elif far_free:
        slope[NAIL_RADIUS] += _add_end(ray, far, share, slope)
    if inner_far > inner_near and (empty or not bored[0] < inner_near < bored[1]):
        _add_end(ray, inner_near, -share, slope)
    if inner_far > inner_near and (empty or not bored[0] < inner_far < bored[1]):
        _add_end(ray, inner_far, -share, slope)
    return shade


@compiled
def shade_at_bore(
    ray: Ray,
    tube: Tube,
    bore: Bore,
    step_mm: float,
    unit_mm: float,
    steel_mm: float,
    material: Material,
    slope: NDArray[np.float32],
) -> Shade:
    """Shade of a ray that a bore touches, mean over the bore's radius from `-step_mm` to `step_mm`."""
    wide, narrow = in_bore(ray, bore, step_mm), in_bore(ray, bore, -step_mm)
    in_wide = within(tube, wide[0], wide[1])
    in_narrow = within(tube, narrow[0], narrow[1]) if narrow[1] > narrow[0] else 0.0
    if in_wide <= in_narrow:
        return _behind_bore(ray, tube, bore, wide, 1.0, unit_mm, steel_mm, material, slope)
    middle = in_bore(ray, bore, 0.0)
    low = _behind_bore(ray, tube, bore, narrow, 1.0 / 6.0, unit_mm, steel_mm, material, slope)
    central = _behind_bore(ray, tube, bore, middle, 4.0 / 6.0, unit_mm, steel_mm, material, slope)
    high = _behind_bore(ray, tube, bore, wide, 1.0 / 6.0, unit_mm, steel_mm, material, slope)
    by_radius = (high[0] - low[0]) / (2.0 * step_mm)
    slope[HOLE_RADIUS] += by_radius
    if narrow[1] <= narrow[0]:
        narrow = (0.5 * (wide[0] + wide[1]), 0.5 * (wide[0] + wide[1]))
    before, after = within(tube, wide[0], narrow[0]), within(tube, narrow[1], wide[1])
    if before > 0.0:
        _add_wall(ray, tube, bore, wide[0], narrow[0], by_radius * before / (before + after), slope)
    if after > 0.0:
        _add_wall(ray, tube, bore, narrow[1], wide[1], by_radius * after / (before + after), slope)
    return mean_shade(low, central, high)
