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

from services.registration.core.compiled import compiled
from services.registration.core.nail.bore_shade import shade_at_bore
from services.registration.core.nail.pixel_rays import FIRST_SAMPLES, PixelRays, SteelBeside
from services.registration.core.nail.ray_geometry import (
    LEAST_STEP_MM,
    NO_TUBE,
    Ray,
    Tube,
    bore_and_rim_near,
    bore_at,
    meets,
    outline_near,
    ray_through,
    tube_of,
)
from services.registration.core.nail.shade import HARDENING, LOG_ATTENUATION
from services.registration.core.nail.tube_shade import shade_at_tube

_UNIFORM = 0.02
_SOFTENING_PX = 0.15
# Half a pixel's diagonal (0.7), what samples are softened by (0.15), and some more, as just inside an edge paths are
# much curved: with 1.0, single pixels changed by up to 0.009 of what passes, with 1.5 by 0.003.
_EDGE_REACH_PX = 1.5


class NailShape(NamedTuple):
    """The nail as the rays meet it.

    Attributes
    ----------
    rotation, translation_mm
        `camera_from_nail`, shapes (3, 3) and (3,).
    radius_mm, cannulation_radius_mm
        Of the nail and of the canal along it (0: solid).
    bores
        Per hole: point, unit direction, radius, and distance from the point beyond which the bore widens by as much as
        it goes on (its chamfer), in the nail's frame, shape (H, 8). Bores must not cross one another.
    attenuation, hardening
        Mean of the X-rays' attenuations, per mm, and how much they differ (`shade.py`).
    steel_in_nail_material
        How many mm of the nail's material attenuate as 1 mm of steel does.
    """

    rotation: NDArray[np.float64]
    translation_mm: NDArray[np.float64]
    radius_mm: float
    cannulation_radius_mm: float
    bores: NDArray[np.float64]
    attenuation: float
    hardening: float
    steel_in_nail_material: float


@compiled
def _add_sample(
    ray: Ray, tube: Tube, nail: NailShape, step_mm: float, unit_mm: float, steel_mm: float, slope: NDArray[np.float32]
) -> float:
    """Share that passes along one ray; its derivatives are added to `slope`.

    Bores are looked for in the tube (in `NO_TUBE` none is); `steel_mm` are mm of the nail's material.
    """
    material = (nail.attenuation, nail.hardening)
    radius_mm, inner_mm = nail.radius_mm, nail.cannulation_radius_mm
    touched = -1
    if tube[1] > tube[0]:
        for h in range(nail.bores.shape[0]):
            if meets(ray, tube, bore_at(nail.bores, h), radius_mm, step_mm):
                touched = h
    if touched >= 0:
        shade = shade_at_bore(ray, tube, bore_at(nail.bores, touched), step_mm, unit_mm, steel_mm, material, slope)
    else:
        shade = shade_at_tube(ray, radius_mm, inner_mm, step_mm, unit_mm, steel_mm, material, slope)
    slope[LOG_ATTENUATION] += shade[1]
    slope[HARDENING] += shade[2]
    return shade[0]


@compiled
def _bore_and_edge_near(cx: float, cy: float, nail: NailShape, reach_mm: float) -> tuple[bool, bool]:
    """Whether a bore, and whether any edge of the nail, is less than `reach_mm` from the ray through (cx, cy, 1)."""
    ray = ray_through(cx, cy, nail.rotation, nail.translation_mm)
    radius_mm, inner_mm = nail.radius_mm, nail.cannulation_radius_mm
    bore_near, rim_near = bore_and_rim_near(ray, radius_mm, inner_mm, nail.bores, reach_mm)
    return bore_near, rim_near or outline_near(ray, radius_mm, inner_mm, reach_mm)


@compiled
def trace(
    rays: PixelRays,
    samples_px: NDArray[np.float64],
    steel: SteelBeside,
    nail: NailShape,
    passed: NDArray[np.float64],
    by_cause: NDArray[np.float32],
) -> None:
    """Mean over each pixel of the share that passes, with more samples where the first four differ.

    Of pixels away from all edges and from other steel the middle is taken.

    Parameters
    ----------
    rays
        Of the S pixels.
    samples_px
        Places within a pixel, shape (K, 2); the first four stand for the pixel by themselves.
    steel
        Balls and wires beside the nail.
    passed
        Result, shape (S,).
    by_cause
        Its derivatives, shape (S, DERIVATIVES): by a small motion of the nail in its own frame (rad, mm), by radii and
        material.
    """
    for n in range(rays.slopes.shape[0]):
        right_x, right_y, down_x, down_y = rays.right[n, 0], rays.right[n, 1], rays.down[n, 0], rays.down[n, 1]
        slope = by_cause[n]
        slope[:] = 0.0
        total, least, most, count = 0.0, 2.0, -1.0, 0
        pixel_mm = nail.translation_mm[2] * np.sqrt(right_x * right_x + right_y * right_y)
        step_mm = max(_SOFTENING_PX * pixel_mm, LEAST_STEP_MM)
        bore_near, edge_near = _bore_and_edge_near(
            rays.slopes[n, 0], rays.slopes[n, 1], nail, _EDGE_REACH_PX * pixel_mm
        )
        row = steel.row[n]
        several = edge_near or row >= 0
        for k in range(samples_px.shape[0]):
            if (k == FIRST_SAMPLES and most - least < _UNIFORM) or (k == 1 and not several):
                break
            cx, cy = rays.slopes[n, 0], rays.slopes[n, 1]
            if several:
                cx += samples_px[k, 0] * right_x + samples_px[k, 1] * down_x
                cy += samples_px[k, 0] * right_y + samples_px[k, 1] * down_y
            ray = ray_through(cx, cy, nail.rotation, nail.translation_mm)
            tube = tube_of(ray, nail.radius_mm, nail.cannulation_radius_mm) if bore_near else NO_TUBE
            unit_mm = np.sqrt(cx * cx + cy * cy + 1.0)
            beside_mm = nail.steel_in_nail_material * steel.path_mm[row, k] if row >= 0 else 0.0
            share = _add_sample(ray, tube, nail, step_mm, unit_mm, beside_mm, slope)
            total += share
            least, most = min(least, share), max(most, share)
            count += 1
        passed[n] = total / count
        slope /= count
