"""What passes along a ray that meets the nail but no bore, and how it changes: by the ray's distance from the axis.

Near an edge, where the derivative has no bound, it is a mean and a difference over a short way of that distance.
"""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.compiled import compiled
from services.registration.core.nail.ray_geometry import Ray
from services.registration.core.nail.shade import NAIL_RADIUS, Material, Shade, mean_shade, shade_behind

# So many steps from an edge, the difference over a step is the derivative.
_NEAR_EDGE = 5.0


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
    low = shade_behind(chord * _half_chord(impact - step_mm, radius_mm, inner_mm) + steel_mm, material)
    middle = shade_behind(metal_mm + steel_mm, material)
    high = shade_behind(chord * _half_chord(impact + step_mm, radius_mm, inner_mm) + steel_mm, material)
    by_impact = (high[0] - low[0]) / (2.0 * step_mm)
    # Half the chord is a root of radius² - impact²: at the outline the two move it alike, elsewhere it is smooth. Of a
    # wall so thin that the cannulation's edge is as near it would be wrong; none is thinner than a pixel.
    if radius_mm - abs(impact) < _NEAR_EDGE * step_mm:
        by_radius = -by_impact * radius_mm / impact
    else:
        by_radius = middle[1] / (metal_mm + steel_mm) * chord * radius_mm / np.sqrt(radius_mm**2 - impact**2)
    return mean_shade(low, middle, high), by_impact, by_radius


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
    shade = shade_behind(path_mm, material)
    by_half_chord = shade[1] / path_mm * chord
    return shade, by_half_chord * by_impact, by_half_chord * radius_mm / outer


@compiled
def shade_at_tube(
    ray: Ray,
    radius_mm: float,
    inner_mm: float,
    step_mm: float,
    unit_mm: float,
    steel_mm: float,
    material: Material,
    slope: NDArray[np.float32],
) -> Shade:
    """Shade of a ray that no bore touches."""
    ox, oy, oz, dx, dy, dz = ray
    across = np.sqrt(dy * dy + dz * dz)
    my, mz = -dz / across, dy / across
    impact = oy * my + oz * mz
    if abs(impact) > radius_mm + step_mm:
        return shade_behind(steel_mm, material)
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
