"""Transmission of the X-rays through the nail in each pixel, and its derivatives by pose, radii and material.

The path of a ray in the nail ends at surfaces: at the nail's, a bore's or the cannulation's. A surface that the ray
grazes is a step in the image, or worse, and a few samples in a pixel see it jump. Each sample is therefore a mean
over a bore's radius, or over the ray's distance from the nail's axis, 0.15 pixel to either side. Then the
derivative by radius or distance is a plain difference, and that by the nail's motion follows from how the surface moves
along its normal where the ray runs beside it.

A path's end on a surface moves along the ray by (g . v) / (g . d) when the surface moves by v, with its normal g and
the ray's direction d. Along a bore's wall that has no bound; there the derivative by the radius is a difference, and
the wall's motion along its normal is a change of radius.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.rays import (
    FIRST_SAMPLES,
    LEAST_STEP_MM,
    NO_TUBE,
    Bore,
    Material,
    NailShape,
    PixelRays,
    Ray,
    SteelPaths,
    Tube,
    beside_bore,
    bore_and_rim_near,
    bore_at,
    chamfered,
    cone,
    in_bore,
    meets,
    outline_near,
    ray_through,
    tube_of,
    within,
)
from shared.compiled import compiled, compiled_inline

# Columns of the derivatives: small motion of the nail in its own frame (rotation vector, translation), radii, material.
MOTION_SIZE = 6
BY_HOLE_RADIUS, BY_NAIL_RADIUS, BY_CHAMFER, BY_LOG_ATTENUATION, BY_HARDENING = range(MOTION_SIZE, MOTION_SIZE + 5)
DERIVATIVES = MOTION_SIZE + 5

# Guard: below, the law is the exponential one, and its derivative the first term of a series.
_NO_HARDENING = 1e-3
# Guard: rays along a surface would move their ends without bound.
_LEAST_INCIDENCE = 0.002

# Transmission, and its derivatives by the logarithm of the attenuation and by the hardening.
PathTransmission = tuple[float, float, float]


class TraceLimits(NamedTuple):
    """`RAY_SAMPLING`, which compiled code cannot read."""

    edge_reach_px: float
    uniform_difference: float
    softening_px: float
    near_edge_in_steps: float


class RayContext(NamedTuple):
    """What is the same all along one ray."""

    unit_mm: float  # length of the ray's direction
    steel_mm: float  # path in steel other than the nail, in mm of the nail's material
    step_mm: float  # half width of the mean at a grazed surface
    near_edge_mm: float  # distance from an edge from which derivatives are analytic
    material: Material  # of the nail


@compiled_inline
def transmission_behind(path_mm: float, material: Material) -> PathTransmission:
    """exp(-f * d) * (1 + h * (1 - f) * d)^(-1 / h) behind a path of depth d; its derivatives by log d and by h.

    Transmission of a beam whose attenuations are f times their mean (d counts the mean) and above that gamma
    distributed with relative variance h, the hardening: the first tenths of a millimetre attenuate most.
    """
    depth, hardening, hardest = material[0] * path_mm, material[1], material[2]
    if depth <= 0.0:
        return 1.0, 0.0, 0.0
    soft = (1.0 - hardest) * depth
    if hardening < _NO_HARDENING:
        transmission = np.exp(-depth)
        return transmission, -depth * transmission, 0.5 * soft * soft * transmission
    # log1p would be exact for a vanishing path too, where nothing depends on it, and takes about twice as long
    logarithm, left = np.log(1.0 + hardening * soft) / hardening, soft / (1.0 + hardening * soft)
    transmission = np.exp(-hardest * depth - logarithm)
    return transmission, -(hardest * depth + left) * transmission, (logarithm - left) / hardening * transmission


@compiled_inline
def mean_transmission(low: PathTransmission, middle: PathTransmission, high: PathTransmission) -> PathTransmission:
    """Mean over a short interval (Simpson's rule)."""
    return (
        (low[0] + 4.0 * middle[0] + high[0]) / 6.0,
        (low[1] + 4.0 * middle[1] + high[1]) / 6.0,
        (low[2] + 4.0 * middle[2] + high[2]) / 6.0,
    )


@compiled_inline
def add_surface_motion(
    x: float, y: float, z: float, gx: float, gy: float, gz: float, share: float, slope: NDArray[np.float32]
) -> None:
    """Add the derivatives by the motion of a surface at (x, y, z) along its normal g."""
    slope[0] += share * (y * gz - z * gy)
    slope[1] += share * (z * gx - x * gz)
    slope[2] += share * (x * gy - y * gx)
    slope[3] += share * gx
    slope[4] += share * gy
    slope[5] += share * gz


@compiled_inline
def _half_chord(impact_mm: float, radius_mm: float, inner_mm: float) -> float:
    """Half the chord of a tube's cross-section at a distance from its axis."""
    outer, inner = radius_mm**2 - impact_mm**2, inner_mm**2 - impact_mm**2
    return float(np.sqrt(max(outer, 0.0)) - np.sqrt(max(inner, 0.0)))


@compiled_inline
def _tube_at_edge(
    impact: float, radius_mm: float, inner_mm: float, chord: float, context: RayContext
) -> tuple[PathTransmission, float, float]:
    """Near an edge: a mean over the distance from the axis, and its derivatives by that distance and the radius."""
    step_mm, steel_mm, material = context.step_mm, context.steel_mm, context.material
    metal_mm = chord * _half_chord(impact, radius_mm, inner_mm)
    low = transmission_behind(chord * _half_chord(impact - step_mm, radius_mm, inner_mm) + steel_mm, material)
    middle = transmission_behind(metal_mm + steel_mm, material)
    high = transmission_behind(chord * _half_chord(impact + step_mm, radius_mm, inner_mm) + steel_mm, material)
    by_impact = (high[0] - low[0]) / (2.0 * step_mm)
    # Half the chord is a root of radius² - impact²: at the outline the two move it alike, elsewhere it is smooth. Of a
    # wall so thin that the cannulation's edge is as near it would be wrong; none is thinner than a pixel.
    if radius_mm - abs(impact) < context.near_edge_mm:
        by_radius = -by_impact * radius_mm / impact
    else:
        by_radius = middle[1] / (metal_mm + steel_mm) * chord * radius_mm / np.sqrt(radius_mm**2 - impact**2)
    return mean_transmission(low, middle, high), by_impact, by_radius


@compiled_inline
def _tube_inside(
    impact: float, radius_mm: float, inner_mm: float, chord: float, context: RayContext
) -> tuple[PathTransmission, float, float]:
    """The same where no edge is near: there the derivatives are those of the chord."""
    outer = np.sqrt(radius_mm**2 - impact**2)
    by_impact = -impact / outer
    inner = 0.0
    if abs(impact) < inner_mm:
        inner = np.sqrt(inner_mm**2 - impact**2)
        by_impact += impact / inner
    path_mm = chord * (outer - inner) + context.steel_mm
    found = transmission_behind(path_mm, context.material)
    by_half_chord = found[1] / path_mm * chord
    return found, by_half_chord * by_impact, by_half_chord * radius_mm / outer


@compiled_inline
def transmission_through_tube(
    ray: Ray, radius_mm: float, inner_mm: float, context: RayContext, slope: NDArray[np.float32]
) -> PathTransmission:
    """Transmission along a ray that no bore touches."""
    ox, oy, oz, dx, dy, dz = ray
    across = np.sqrt(dy * dy + dz * dz)
    my, mz = -dz / across, dy / across
    impact = oy * my + oz * mz
    if abs(impact) > radius_mm + context.step_mm:
        return transmission_behind(context.steel_mm, context.material)
    chord = 2.0 * context.unit_mm / across
    if radius_mm - abs(impact) < context.near_edge_mm or abs(inner_mm - abs(impact)) < context.near_edge_mm:
        found, by_impact, by_radius = _tube_at_edge(impact, radius_mm, inner_mm, chord, context)
    else:
        found, by_impact, by_radius = _tube_inside(impact, radius_mm, inner_mm, chord, context)
    metal_mm = chord * _half_chord(impact, radius_mm, inner_mm)
    turning = found[1] * metal_mm / (metal_mm + context.steel_mm) * dx / across if metal_mm > 0.0 else 0.0
    x = ox - (oy * dy + oz * dz) / (across * across) * dx
    slope[1] += by_impact * x * mz + turning * my
    slope[2] += turning * mz - by_impact * x * my
    slope[4] -= by_impact * my
    slope[5] -= by_impact * mz
    slope[BY_NAIL_RADIUS] += by_radius
    return found


@compiled_inline
def _add_end(ray: Ray, place: float, share: float, slope: NDArray[np.float32]) -> float:
    """Add the motion of a path's end on the nail or its cannulation; returns the share that the radius has."""
    ox, oy, oz, dx, dy, dz = ray
    x, y, z = ox + place * dx, oy + place * dy, oz + place * dz
    norm = np.sqrt(y * y + z * z)
    share /= max(abs(y * dy + z * dz) / norm, _LEAST_INCIDENCE)
    add_surface_motion(x, y, z, 0.0, y / norm, z / norm, share, slope)
    return share


@compiled_inline
def _add_cone_end(
    ray: Ray, place: float, inwards: float, bore: Bore, weight: float, slope: NDArray[np.float32]
) -> None:
    """Add the motion of a path's end on a bore's chamfer; `weight` is the derivative of what passes by the length."""
    _, gx, gy, gz = cone(ray, place, bore)
    share = weight / (-inwards * (gx * ray[3] + gy * ray[4] + gz * ray[5]))
    x, y, z = ray[0] + place * ray[3], ray[1] + place * ray[4], ray[2] + place * ray[5]
    add_surface_motion(x, y, z, gx, gy, gz, share, slope)
    slope[BY_HOLE_RADIUS] -= share
    slope[BY_CHAMFER] -= share
    slope[BY_NAIL_RADIUS] += share


@compiled_inline
def _add_wall(
    ray: Ray, tube: Tube, bore: Bore, first: float, last: float, share: float, slope: NDArray[np.float32]
) -> None:
    """Add the motion of a bore's wall along a stretch of the ray, as the middle of the stretch sees it."""
    middle = 0.5 * (max(first, tube[0]) + min(last, tube[1]))
    x, y, z = ray[0] + middle * ray[3], ray[1] + middle * ray[4], ray[2] + middle * ray[5]
    px, py, pz = x - bore[0], y - bore[1], z - bore[2]
    _, gx, gy, gz = beside_bore(px, py, pz, bore)
    norm = np.sqrt(gx * gx + gy * gy + gz * gz)
    add_surface_motion(x, y, z, gx / norm, gy / norm, gz / norm, share, slope)


@compiled_inline
def _behind_bore(
    ray: Ray,
    tube: Tube,
    bore: Bore,
    bored: tuple[float, float],
    weight: float,
    context: RayContext,
    slope: NDArray[np.float32],
) -> PathTransmission:
    """Transmission along a ray that is in a bore between two places; adds derivatives by the other ends, weighted."""
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
    path_mm = context.unit_mm * max(metal, 0.0) + context.steel_mm
    found = transmission_behind(path_mm, context.material)
    if metal <= 0.0 or found[1] == 0.0:
        return found
    share = weight * found[1] / path_mm * context.unit_mm
    if near_free and near_cut > 0.0:
        _add_cone_end(ray, near + near_cut, 1.0, bore, share, slope)
    elif near_free:
        slope[BY_NAIL_RADIUS] += _add_end(ray, near, share, slope)
    if far_free and far_cut > 0.0:
        _add_cone_end(ray, far - far_cut, -1.0, bore, share, slope)
    elif far_free:
        slope[BY_NAIL_RADIUS] += _add_end(ray, far, share, slope)
    if inner_far > inner_near and (empty or not bored[0] < inner_near < bored[1]):
        _add_end(ray, inner_near, -share, slope)
    if inner_far > inner_near and (empty or not bored[0] < inner_far < bored[1]):
        _add_end(ray, inner_far, -share, slope)
    return found


@compiled_inline
def transmission_at_bore(
    ray: Ray, tube: Tube, bore: Bore, context: RayContext, slope: NDArray[np.float32]
) -> PathTransmission:
    """Transmission along a ray that a bore touches, mean over the bore's radius from `-step_mm` to `step_mm`."""
    step_mm = context.step_mm
    wide, narrow = in_bore(ray, bore, step_mm), in_bore(ray, bore, -step_mm)
    in_wide = within(tube, wide[0], wide[1])
    in_narrow = within(tube, narrow[0], narrow[1]) if narrow[1] > narrow[0] else 0.0
    if in_wide <= in_narrow:
        return _behind_bore(ray, tube, bore, wide, 1.0, context, slope)
    middle = in_bore(ray, bore, 0.0)
    low = _behind_bore(ray, tube, bore, narrow, 1.0 / 6.0, context, slope)
    central = _behind_bore(ray, tube, bore, middle, 4.0 / 6.0, context, slope)
    high = _behind_bore(ray, tube, bore, wide, 1.0 / 6.0, context, slope)
    by_radius = (high[0] - low[0]) / (2.0 * step_mm)
    slope[BY_HOLE_RADIUS] += by_radius
    if narrow[1] <= narrow[0]:
        narrow = (0.5 * (wide[0] + wide[1]), 0.5 * (wide[0] + wide[1]))
    before, after = within(tube, wide[0], narrow[0]), within(tube, narrow[1], wide[1])
    if before > 0.0:
        _add_wall(ray, tube, bore, wide[0], narrow[0], by_radius * before / (before + after), slope)
    if after > 0.0:
        _add_wall(ray, tube, bore, narrow[1], wide[1], by_radius * after / (before + after), slope)
    return mean_transmission(low, central, high)


@compiled_inline
def _add_sample(ray: Ray, tube: Tube, nail: NailShape, context: RayContext, slope: NDArray[np.float32]) -> float:
    """Transmission along one ray; its derivatives are added to `slope`.

    Bores are sought in the tube (in `NO_TUBE` none is).
    """
    touched = -1
    if tube[1] > tube[0]:
        for h in range(nail.bores.shape[-2]):
            if meets(ray, tube, bore_at(nail.bores, h), nail.radius_mm, context.step_mm):
                touched = h
    if touched >= 0:
        found = transmission_at_bore(ray, tube, bore_at(nail.bores, touched), context, slope)
    else:
        found = transmission_through_tube(ray, nail.radius_mm, nail.cannulation_radius_mm, context, slope)
    slope[BY_LOG_ATTENUATION] += found[1]
    slope[BY_HARDENING] += found[2]
    return found[0]


@compiled_inline
def _bore_and_edge_near(cx: float, cy: float, nail: NailShape, reach_mm: float) -> tuple[bool, bool]:
    """Whether a bore, and whether any edge of the nail, is less than `reach_mm` from the ray through (cx, cy, 1)."""
    ray = ray_through(cx, cy, nail.rotation, nail.translation_mm)
    radius_mm, inner_mm = nail.radius_mm, nail.cannulation_radius_mm
    bore_near, rim_near = bore_and_rim_near(ray, radius_mm, inner_mm, nail.bores, reach_mm)
    return bore_near, rim_near or outline_near(ray, radius_mm, inner_mm, reach_mm)


@compiled
def trace_pixels(
    rays: PixelRays,
    samples_px: NDArray[np.float64],
    steel: SteelPaths,
    nail: NailShape,
    limits: TraceLimits,
    transmission: NDArray[np.float64],
    derivatives: NDArray[np.float32],
) -> None:
    """Mean transmission over each pixel, with more samples where the first four differ.

    Pixels away from all edges and from other steel have one sample, in their middle.

    Parameters
    ----------
    rays
        Of the S pixels.
    samples_px
        Places within a pixel, shape (K, 2); the first four stand for the pixel by themselves.
    steel
        Balls and wires beside the nail.
    transmission
        Result, shape (S,).
    derivatives
        Its derivatives, shape (S, DERIVATIVES): by a small motion of the nail in its own frame (rad, mm), by radii and
        material.
    """
    for n in range(rays.slopes.shape[0]):
        right_x, right_y, down_x, down_y = rays.right[n, 0], rays.right[n, 1], rays.down[n, 0], rays.down[n, 1]
        slope = derivatives[n]
        slope[:] = 0.0
        total, least, most, count = 0.0, 2.0, -1.0, 0
        pixel_mm = nail.translation_mm[2] * np.sqrt(right_x * right_x + right_y * right_y)
        step_mm = max(limits.softening_px * pixel_mm, LEAST_STEP_MM)
        reach_mm, near_edge_mm = limits.edge_reach_px * pixel_mm, limits.near_edge_in_steps * step_mm
        bore_near, edge_near = _bore_and_edge_near(rays.slopes[n, 0], rays.slopes[n, 1], nail, reach_mm)
        row = steel.row[n]
        several = edge_near or row >= 0
        for k in range(samples_px.shape[0]):
            if (k == FIRST_SAMPLES and most - least < limits.uniform_difference) or (k == 1 and not several):
                break
            cx, cy = rays.slopes[n, 0], rays.slopes[n, 1]
            if several:
                cx += samples_px[k, 0] * right_x + samples_px[k, 1] * down_x
                cy += samples_px[k, 0] * right_y + samples_px[k, 1] * down_y
            ray = ray_through(cx, cy, nail.rotation, nail.translation_mm)
            tube = tube_of(ray, nail.radius_mm, nail.cannulation_radius_mm) if bore_near else NO_TUBE
            unit_mm = np.sqrt(cx * cx + cy * cy + 1.0)
            beside_mm = nail.steel_in_nail_material * steel.path_mm[row, k] if row >= 0 else 0.0
            context = RayContext(unit_mm, beside_mm, step_mm, near_edge_mm, nail.material)
            share = _add_sample(ray, tube, nail, context, slope)
            total += share
            least, most = min(least, share), max(most, share)
            count += 1
        transmission[n] = total / count
        slope /= count
