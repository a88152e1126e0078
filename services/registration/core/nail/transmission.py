"""Share of the X-rays that pass the nail in each pixel, and how it changes with the nail's motion, radii and material.

The path of a ray in the nail ends at surfaces: at the nail's, a bore's or the cannulation's. A surface that the ray
grazes is a step in the picture, or worse, and a few samples in a pixel see it jump. Each sample is therefore a mean
over a bore's radius, or over the ray's distance from the nail's axis, a sixth of a pixel to either side. Then the
derivative by radius or distance is a plain difference, and that by the nail's motion follows from how the surface moves
along its normal where the ray runs beside it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.compiled import compiled
from services.registration.core.nail.paths import cylinder_interval

# Columns of the derivatives: small motion of the nail in its own frame (rotation vector, translation), radii, material.
MOTION_SIZE = 6
HOLE_RADIUS, NAIL_RADIUS, CHAMFER, LOG_ATTENUATION, POWER = range(MOTION_SIZE, MOTION_SIZE + 5)
DERIVATIVES = MOTION_SIZE + 5

_FIRST_SAMPLES = 4
_UNIFORM = 0.02
_OPAQUE = 200.0
_SOFTENING_PX = 0.15
_LEAST_STEP_MM = 1e-4
_LEAST_INCIDENCE = 0.002
_LEAST_RATE = 0.2
# So many steps from an edge, the difference over a step is the derivative.
_NEAR_EDGE = 5.0

Ray = tuple[float, float, float, float, float, float]
Tube = tuple[float, float, float, float]
Material = tuple[float, float]
Shade = tuple[float, float, float]


class RayArguments(NamedTuple):
    """Arguments of the kernel, in its order (see `trace`)."""

    slopes: NDArray[np.float64]
    right: NDArray[np.float64]
    down: NDArray[np.float64]
    samples_px: NDArray[np.float64]
    crossed: NDArray[np.bool_]
    steel_mm: NDArray[np.float64]
    rotation: NDArray[np.float64]
    translation_mm: NDArray[np.float64]
    radius_mm: float
    cannulation_radius_mm: float
    bores: NDArray[np.float64]
    attenuation: float
    power: float


@compiled
def _ray(cx: float, cy: float, rotation: NDArray[np.float64], translation_mm: NDArray[np.float64]) -> Ray:
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


@compiled
def _tube(ray: Ray, radius_mm: float, inner_mm: float) -> Tube:
    """Where the ray is inside the nail, and where inside its cannulation: near, far, inner near, inner far."""
    ox, oy, oz, dx, dy, dz = ray
    near, far = cylinder_interval(ox, oy, oz, dx, dy, dz, 1.0, 0.0, 0.0, radius_mm)
    inner_near, inner_far = 1.0, 0.0
    if inner_mm > 0.0 and far > near:
        inner_near, inner_far = cylinder_interval(ox, oy, oz, dx, dy, dz, 1.0, 0.0, 0.0, inner_mm)
    return near, far, inner_near, inner_far


@compiled
def _within(tube: Tube, first: float, last: float) -> float:
    """Length of a stretch of the ray that lies in the tube's metal."""
    near, far, inner_near, inner_far = tube
    in_nail = max(0.0, min(last, far) - max(first, near))
    return in_nail - max(0.0, min(last, inner_far) - max(first, inner_near))


@compiled
def _in_bore(ray: Ray, bore: NDArray[np.float64], excess_mm: float) -> tuple[float, float]:
    """Where the ray is inside a bore whose radius is larger by so much."""
    ox, oy, oz, dx, dy, dz = ray
    qx, qy, qz = ox - bore[0], oy - bore[1], oz - bore[2]
    return cylinder_interval(qx, qy, qz, dx, dy, dz, bore[3], bore[4], bore[5], bore[6] + excess_mm)


@compiled
def _shade(path_mm: float, material: Material) -> Shade:
    """exp(-depth^power) behind a path, and its derivatives by the logarithm of the depth and by the power."""
    depth = material[0] * path_mm
    if depth <= 0.0:
        return 1.0, 0.0, 0.0
    if depth > _OPAQUE:
        return 0.0, 0.0, 0.0
    logarithm = np.log(depth)
    shade = np.exp(material[1] * logarithm)
    passed = np.exp(-shade)
    return passed, -material[1] * shade * passed, -shade * logarithm * passed


@compiled
def _mean_shade(low: Shade, middle: Shade, high: Shade) -> Shade:
    """Mean over a short way (Simpson's rule)."""
    return (
        (low[0] + 4.0 * middle[0] + high[0]) / 6.0,
        (low[1] + 4.0 * middle[1] + high[1]) / 6.0,
        (low[2] + 4.0 * middle[2] + high[2]) / 6.0,
    )


@compiled
def _add_motion(
    x: float, y: float, z: float, gx: float, gy: float, gz: float, share: float, slope: NDArray[np.float64]
) -> None:
    """Add what the motion of a surface at (x, y, z) along its normal g contributes."""
    slope[0] += share * (y * gz - z * gy)
    slope[1] += share * (z * gx - x * gz)
    slope[2] += share * (x * gy - y * gx)
    slope[3] += share * gx
    slope[4] += share * gy
    slope[5] += share * gz


@compiled
def _add_end(ray: Ray, place: float, share: float, slope: NDArray[np.float64]) -> float:
    """Add the motion of a path's end on the nail or its cannulation; returns the share that the radius has."""
    ox, oy, oz, dx, dy, dz = ray
    x, y, z = ox + place * dx, oy + place * dy, oz + place * dz
    norm = np.sqrt(y * y + z * z)
    share /= max(abs(y * dy + z * dz) / norm, _LEAST_INCIDENCE)
    _add_motion(x, y, z, 0.0, y / norm, z / norm, share, slope)
    return share


@compiled
def _cone(ray: Ray, place: float, bore: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """How far a point is inside a bore's chamfer (mm, negative outside), and the gradient of that."""
    px, py, pz = ray[0] + place * ray[3] - bore[0], ray[1] + place * ray[4] - bore[1], ray[2] + place * ray[5] - bore[2]
    along = px * bore[3] + py * bore[4] + pz * bore[5]
    gx, gy, gz = px - along * bore[3], py - along * bore[4], pz - along * bore[5]
    aside = max(np.sqrt(gx * gx + gy * gy + gz * gz), _LEAST_STEP_MM)
    side = 1.0 if along > 0.0 else -1.0
    inside = side * along - bore[7] - (aside - bore[6])
    return inside, side * bore[3] - gx / aside, side * bore[4] - gy / aside, side * bore[5] - gz / aside


@compiled
def _chamfered(ray: Ray, place: float, inwards: float, bore: NDArray[np.float64]) -> float:
    """Length of the ray, in units of its direction, from an end inwards, that a bore's chamfer takes away."""
    inside, gx, gy, gz = _cone(ray, place, bore)
    rate = -inwards * (gx * ray[3] + gy * ray[4] + gz * ray[5])
    return max(inside, 0.0) / rate if rate > _LEAST_RATE else 0.0


@compiled
def _add_cone_end(
    ray: Ray, place: float, inwards: float, bore: NDArray[np.float64], weight: float, slope: NDArray[np.float64]
) -> None:
    """Add the motion of a path's end on a bore's chamfer; `weight` is the derivative of what passes by the length."""
    _, gx, gy, gz = _cone(ray, place, bore)
    share = weight / (-inwards * (gx * ray[3] + gy * ray[4] + gz * ray[5]))
    x, y, z = ray[0] + place * ray[3], ray[1] + place * ray[4], ray[2] + place * ray[5]
    _add_motion(x, y, z, gx, gy, gz, share, slope)
    slope[HOLE_RADIUS] -= share
    slope[CHAMFER] -= share
    slope[NAIL_RADIUS] += share


@compiled
def _add_wall(
    ray: Ray, tube: Tube, bore: NDArray[np.float64], first: float, last: float, share: float, slope: NDArray[np.float64]
) -> None:
    """Add the motion of a bore's wall along a stretch of the ray, as the middle of the stretch sees it."""
    middle = 0.5 * (max(first, tube[0]) + min(last, tube[1]))
    x, y, z = ray[0] + middle * ray[3], ray[1] + middle * ray[4], ray[2] + middle * ray[5]
    px, py, pz = x - bore[0], y - bore[1], z - bore[2]
    along = px * bore[3] + py * bore[4] + pz * bore[5]
    gx, gy, gz = px - along * bore[3], py - along * bore[4], pz - along * bore[5]
    norm = np.sqrt(gx * gx + gy * gy + gz * gz)
    _add_motion(x, y, z, gx / norm, gy / norm, gz / norm, share, slope)


@compiled
def _behind_bore(
    ray: Ray,
    tube: Tube,
    bore: NDArray[np.float64],
    bored: tuple[float, float],
    weight: float,
    unit_mm: float,
    steel_mm: float,
    material: Material,
    slope: NDArray[np.float64],
) -> Shade:
    """Shade of a ray that is in a bore between two places; derivatives by the other ends are added, times `weight`."""
    near, far, inner_near, inner_far = tube
    empty = bored[1] <= bored[0]
    metal = _within(tube, near, far) - (0.0 if empty else _within(tube, bored[0], bored[1]))
    near_free, far_free = empty or not bored[0] < near < bored[1], empty or not bored[0] < far < bored[1]
    near_cut = _chamfered(ray, near, 1.0, bore) if near_free else 0.0
    far_cut = _chamfered(ray, far, -1.0, bore) if far_free else 0.0
    # where the chamfer meets the bore, no end is left between them
    if not empty and near_free and bored[1] > near and near_cut >= bored[0] - near:
        near_cut, near_free = bored[0] - near, False
    if not empty and far_free and bored[0] < far and far_cut >= far - bored[1]:
        far_cut, far_free = far - bored[1], False
    metal = metal - near_cut - far_cut
    path_mm = unit_mm * max(metal, 0.0) + steel_mm
    shade = _shade(path_mm, material)
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
def _at_bore(
    ray: Ray,
    tube: Tube,
    bore: NDArray[np.float64],
    step_mm: float,
    unit_mm: float,
    steel_mm: float,
    material: Material,
    slope: NDArray[np.float64],
) -> Shade:
    """Shade of a ray that a bore touches, mean over the bore's radius from `-step_mm` to `step_mm`."""
    wide, narrow = _in_bore(ray, bore, step_mm), _in_bore(ray, bore, -step_mm)
    in_wide = _within(tube, wide[0], wide[1])
    in_narrow = _within(tube, narrow[0], narrow[1]) if narrow[1] > narrow[0] else 0.0
    if in_wide <= in_narrow:
        return _behind_bore(ray, tube, bore, wide, 1.0, unit_mm, steel_mm, material, slope)
    middle = _in_bore(ray, bore, 0.0)
    low = _behind_bore(ray, tube, bore, narrow, 1.0 / 6.0, unit_mm, steel_mm, material, slope)
    central = _behind_bore(ray, tube, bore, middle, 4.0 / 6.0, unit_mm, steel_mm, material, slope)
    high = _behind_bore(ray, tube, bore, wide, 1.0 / 6.0, unit_mm, steel_mm, material, slope)
    by_radius = (high[0] - low[0]) / (2.0 * step_mm)
    slope[HOLE_RADIUS] += by_radius
    if narrow[1] <= narrow[0]:
        narrow = (0.5 * (wide[0] + wide[1]), 0.5 * (wide[0] + wide[1]))
    before, after = _within(tube, wide[0], narrow[0]), _within(tube, narrow[1], wide[1])
    if before > 0.0:
        _add_wall(ray, tube, bore, wide[0], narrow[0], by_radius * before / (before + after), slope)
    if after > 0.0:
        _add_wall(ray, tube, bore, narrow[1], wide[1], by_radius * after / (before + after), slope)
    return _mean_shade(low, central, high)


@compiled
def _half_chord(impact_mm: float, radius_mm: float, inner_mm: float) -> float:
    """Half the chord of a tube's cross-section at a distance from its axis."""
    outer, inner = radius_mm**2 - impact_mm**2, inner_mm**2 - impact_mm**2
    return float(np.sqrt(max(outer, 0.0)) - np.sqrt(max(inner, 0.0)))


@compiled
def _tube_at_edge(
    impact: float,
    radius_mm: float,
    inner_mm: float,
    step_mm: float,
    chord: float,
    steel_mm: float,
    material: Material,
) -> tuple[Shade, float, float]:
    """Shade near an edge, mean over the distance from the axis, and its derivatives by that distance and the radius."""
    metal_mm = chord * _half_chord(impact, radius_mm, inner_mm)
    low = _shade(chord * _half_chord(impact - step_mm, radius_mm, inner_mm) + steel_mm, material)
    high = _shade(chord * _half_chord(impact + step_mm, radius_mm, inner_mm) + steel_mm, material)
    grown = _shade(chord * _half_chord(impact, radius_mm + step_mm, inner_mm) + steel_mm, material)
    shrunk = _shade(chord * _half_chord(impact, radius_mm - step_mm, inner_mm) + steel_mm, material)
    shade = _mean_shade(low, _shade(metal_mm + steel_mm, material), high)
    return shade, (high[0] - low[0]) / (2.0 * step_mm), (grown[0] - shrunk[0]) / (2.0 * step_mm)


@compiled
def _tube_inside(
    impact: float, radius_mm: float, inner_mm: float, chord: float, steel_mm: float, material: Material
) -> tuple[Shade, float, float]:
    """The same where no edge is near: there the derivatives are those of the chord."""
    outer = np.sqrt(radius_mm**2 - impact**2)
    by_impact = -impact / outer
    inner = 0.0
    if abs(impact) < inner_mm:
        inner = np.sqrt(inner_mm**2 - impact**2)
        by_impact += impact / inner
    path_mm = chord * (outer - inner) + steel_mm
    shade = _shade(path_mm, material)
    by_half_chord = shade[1] / path_mm * chord
    return shade, by_half_chord * by_impact, by_half_chord * radius_mm / outer


@compiled
def _at_tube(
    ray: Ray,
    radius_mm: float,
    inner_mm: float,
    step_mm: float,
    unit_mm: float,
    steel_mm: float,
    material: Material,
    slope: NDArray[np.float64],
) -> Shade:
    """Shade of a ray that no bore touches."""
    ox, oy, oz, dx, dy, dz = ray
    across = np.sqrt(dy * dy + dz * dz)
    my, mz = -dz / across, dy / across
    impact = oy * my + oz * mz
    if abs(impact) > radius_mm + step_mm:
        return _shade(steel_mm, material)
    chord = 2.0 * unit_mm / across
    near_edge = _NEAR_EDGE * step_mm
    if radius_mm - abs(impact) < near_edge or abs(inner_mm - abs(impact)) < near_edge:
        shade, by_impact, by_radius = _tube_at_edge(impact, radius_mm, inner_mm, step_mm, chord, steel_mm, material)
    else:
        shade, by_impact, by_radius = _tube_inside(impact, radius_mm, inner_mm, chord, steel_mm, material)
    metal_mm = chord * _half_chord(impact, radius_mm, inner_mm)
    turning = shade[1] * metal_mm / (metal_mm + steel_mm) * dx / across if metal_mm > 0.0 else 0.0
    x = ox - (oy * dy + oz * dz) / (across * across) * dx
    slope[1] += by_impact * x * mz + turning * my
    slope[2] += turning * mz - by_impact * x * my
    slope[4] -= by_impact * my
    slope[5] -= by_impact * mz
    slope[NAIL_RADIUS] += by_radius
    return shade


@compiled
def _add_sample(
    ray: Ray,
    radius_mm: float,
    inner_mm: float,
    bores: NDArray[np.float64],
    step_mm: float,
    unit_mm: float,
    steel_mm: float,
    material: Material,
    slope: NDArray[np.float64],
) -> float:
    """Share that passes along one ray; its derivatives are added to `slope`."""
    tube = _tube(ray, radius_mm, inner_mm)
    touched = -1
    if tube[1] > tube[0]:
        for h in range(bores.shape[0]):
            chamfer_mm = max(radius_mm - bores[h, 7], 0.0)
            first, last = _in_bore(ray, bores[h], step_mm + chamfer_mm)
            if min(last, tube[1]) > max(first, tube[0]):
                touched = h
    if touched >= 0:
        shade = _at_bore(ray, tube, bores[touched], step_mm, unit_mm, steel_mm, material, slope)
    else:
        shade = _at_tube(ray, radius_mm, inner_mm, step_mm, unit_mm, steel_mm, material, slope)
    slope[LOG_ATTENUATION] += shade[1]
    slope[POWER] += shade[2]
    return shade[0]


@compiled
def trace(
    slopes: NDArray[np.float64],
    right: NDArray[np.float64],
    down: NDArray[np.float64],
    samples_px: NDArray[np.float64],
    crossed: NDArray[np.bool_],
    steel_mm: NDArray[np.float64],
    rotation: NDArray[np.float64],
    translation_mm: NDArray[np.float64],
    radius_mm: float,
    cannulation_radius_mm: float,
    bores: NDArray[np.float64],
    attenuation: float,
    power: float,
    passed: NDArray[np.float64],
    by_cause: NDArray[np.float64],
) -> None:
    """Mean over each pixel of exp(-(attenuation * path)^power), with more samples where the first four differ.

    Parameters
    ----------
    slopes, right, down
        Direction (x, y) at z = 1 of each pixel's middle and its change per column and row, shape (S, 2) each.
    samples_px
        Places within a pixel, shape (K, 2); the first four stand for the pixel by themselves.
    crossed
        Whether an edge may cross the pixel, shape (S,); of the others, the middle is taken.
    steel_mm
        Path in balls, as much of the nail's material as attenuates the same, shape (S, K).
    rotation, translation_mm
        `camera_from_nail`, shapes (3, 3) and (3,).
    bores
        Per hole: point, unit direction, radius, and distance from the point beyond which the bore widens by as much as
        it goes on (its chamfer), in the nail's frame, shape (H, 8). Bores must not cross one another.
    passed
        Result, shape (S,).
    by_cause
        Its derivatives, shape (S, DERIVATIVES): by a small motion of the nail in its own frame (rad, mm), by radii and
        material.
    """
    material = (attenuation, power)
    for n in range(slopes.shape[0]):
        slope = by_cause[n]
        slope[:] = 0.0
        total, least, most, count = 0.0, 2.0, -1.0, 0
        pixel = np.sqrt(right[n, 0] * right[n, 0] + right[n, 1] * right[n, 1])
        step_mm = max(_SOFTENING_PX * translation_mm[2] * pixel, _LEAST_STEP_MM)
        for k in range(samples_px.shape[0]):
            if (k == _FIRST_SAMPLES and most - least < _UNIFORM) or (k == 1 and not crossed[n]):
                break
            cx, cy = slopes[n, 0], slopes[n, 1]
            if crossed[n]:
                cx += samples_px[k, 0] * right[n, 0] + samples_px[k, 1] * down[n, 0]
                cy += samples_px[k, 0] * right[n, 1] + samples_px[k, 1] * down[n, 1]
            ray = _ray(cx, cy, rotation, translation_mm)
            unit_mm = np.sqrt(cx * cx + cy * cy + 1.0)
            share = _add_sample(
                ray, radius_mm, cannulation_radius_mm, bores, step_mm, unit_mm, steel_mm[n, k], material, slope
            )
            total += share
            least, most = min(least, share), max(most, share)
            count += 1
        passed[n] = total / count
        slope /= count
