"""A bent nail as the straight ones of its cross-sections.

A ray crosses the nail over less than 3 mm of its length, along which an arc of 300 mm radius is straight within 0.004
mm. Each ray is therefore traced through the straight nail of the cross-section where it passes nearest to the centre
line, or through that of a hole that it may meet. Cross-sections are taken every half millimetre.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.attenuation import NailShape
from services.registration.core.nail.rays import PixelRays
from services.registration.core.tuning import BENT_NAIL
from shared.geometry.bend import places_along
from shared.geometry.frames import Nail
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform

# Below this cosine a hole's axis lies along the nail, and the reach of its rims along it has no bound.
_LEAST_COSINE = 0.2


def section_places(
    nail: NailPart, curvature_per_m: tuple[float, float], rays: PixelRays, shape: NailShape
) -> NDArray[np.float64]:
    """Arc lengths of the cross-sections in which rays are traced, shape (S,)."""
    spot_mm = -shape.rotation.T @ shape.translation_mm
    directions = np.column_stack([rays.slopes, np.ones(len(rays.slopes))]) @ shape.rotation
    place = places_along(spot_mm, directions, curvature_per_m)
    step_mm = BENT_NAIL.section_step_mm
    chosen, nearest = np.round(place / step_mm) * step_mm, np.full(len(place), np.inf)
    for hole in nail.holes:
        x_mm, lean = float(hole.axis.point_mm[0]), abs(float(hole.axis.direction[0]))
        cosine = max(np.sqrt(1.0 - lean * lean), _LEAST_COSINE)
        reach_mm = (0.5 * hole.diameter_mm + nail.radius_mm * lean) / cosine + BENT_NAIL.about_hole_mm
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
    bores[:, 0] -= x_mm
    return shape._replace(
        rotation=np.ascontiguousarray(shape.rotation @ nail_from_section.rotation),
        translation_mm=shape.rotation @ nail_from_section.translation_mm + shape.translation_mm,
        bores=bores,
    )
