"""The bent nails that look like a straight one, and which of all explains an image best.

A straight nail must reflect the tilts of both holes at once, and the divergence of the rays then contradicts it. A bent
one can also reflect one of two holes, and a change of curvature makes up for the divergence: where an image shows a
curvature, or such a bent nail explains it nearly as well as a straight one, the fit starts from all of these.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.least_squares import LinearSolution, Problem, Solution, minimise, minimise_from
from services.registration.core.nail.parameters import (
    CURVATURE,
    STRAIGHT_NAIL,
    TILTS,
    Parameter,
    clipped_to_bounds,
    curvature_of,
    level_tilts,
)
from services.registration.core.tuning import BENT_NAIL, COMPARISON_STAGE, FINAL_STAGE, TILT_SEARCH_STAGE
from shared.geometry.bend import MM_PER_M
from shared.geometry.lines import angle_between_rad, unit
from shared.geometry.parts import hole_axis


@dataclass(frozen=True, slots=True, eq=False)
class BentOptimum:
    """Best optimum of a nail that may be bent.

    Attributes
    ----------
    solution
        Its parameters.
    margin
        Over the next (see `FitEvidence.mirror_margin`); None without another.
    straight_margin
        Of the pose at which the straight fit ended over the best of the others; None without another.
    near
        The farthest optimum whose axes all lie within 1.5° of its own, among those that explain the image nearly as
        well: where a hole is seen along its axis, its tilt and the reflected one lie side by side. None without one.
    """

    solution: Solution
    margin: float | None
    straight_margin: float | None
    near: Solution | None


def bent_optimum(problem: Problem, begun: LinearSolution) -> BentOptimum | None:
    """Fit with the curvature free from where the straight fit led to, and from its reflections.

    No optimum is found when none is a nail's: canals bend nails to radii of 300 mm and more.
    """
    steps, tolerance = BENT_NAIL.first_steps, FINAL_STAGE.tolerance
    found = [minimise_from(problem, begun, steps, tolerance)]
    for start in reflections(problem, found[0].parameters):
        limit = cost_limit_beside(min(found, key=lambda one: one.cost))
        found.append(minimise(problem, start, steps, tolerance, limit))
    most_per_m = MM_PER_M / BENT_NAIL.least_radius_mm
    nails = [one for one in found if np.hypot(*curvature_of(one.parameters)) <= most_per_m]
    if not nails:
        return None
    best = min(nails, key=lambda one: one.cost)
    return BentOptimum(
        best, _margin(problem, best, found), _margin(problem, found[0], nails), _near(problem, best, nails)
    )


def _margin(problem: Problem, one: Solution, found: list[Solution]) -> float | None:
    others = [other.least_cost for other in found if _differ(problem, other, one)]
    return 0.5 * (min(others) - one.cost) if others else None


def _near(problem: Problem, best: Solution, nails: list[Solution]) -> Solution | None:
    limit = best.cost + 2.0 * BENT_NAIL.near_margin
    least, most = np.radians([BENT_NAIL.near_from_deg, TILT_SEARCH_STAGE.distinct_deg])
    apart = [(apart_rad(problem, one, best), one) for one in nails if one.least_cost < limit]
    return max((pair for pair in apart if least < pair[0] <= most), key=lambda pair: pair[0], default=(0.0, None))[1]


def reflections(problem: Problem, parameters: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Parameters with the tilts of all holes reflected, of those before the middle, and of those behind it.

    In the plane of nail and ray the tilt at a distance x from the middle of the anchors is p - c x, with p the nail's
    own and c the sum of its curvature and the ray's divergence per length. Where one hole's tilt is reflected, p and
    c times the distance change places. Across that plane nothing but roll tilts a hole, and all alike.
    """
    model = problem.model
    pose = model.pose(parameters)
    half_mm = 0.5 * (model.anchors.second_x_mm - model.anchors.first_x_mm)
    middle = pose @ np.array([0.5 * (model.anchors.first_x_mm + model.anchors.second_x_mm), 0.0, 0.0])
    ray, divergence = unit(middle), 1.0 / float(np.linalg.norm(middle))
    curvature = pose.directions(np.array([0.0, *curvature_of(parameters)])) / MM_PER_M
    level_pitch, level_roll = level_tilts(model.nail)
    pitch, roll = parameters[Parameter.PITCH_RAD] - level_pitch, parameters[Parameter.ROLL_RAD] - level_roll
    rate = float(curvature @ ray) + divergence
    for other_pitch, other_rate, sign in (
        (-pitch, -rate, -1.0),
        (rate * half_mm, pitch / half_mm, 1.0),
        (-rate * half_mm, -pitch / half_mm, 1.0),
    ):
        start = parameters.copy()
        start[TILTS] = level_pitch + other_pitch, level_roll + sign * roll
        turned = model.pose(start).rotation
        aside = curvature - float(curvature @ ray) * ray
        start[CURVATURE] = MM_PER_M * ((aside + (other_rate - divergence) * ray) @ turned)[1:]
        yield clipped_to_bounds(start)


def hole_directions(problem: Problem, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions of the hole axes in the camera's frame, shape (H, 3)."""
    nail = problem.model.nail.bent(curvature_of(parameters))
    axes = np.stack([hole_axis(nail, hole).direction for hole in nail.holes])
    return problem.model.pose(parameters).directions(axes)


def apart_rad(problem: Problem, one: Solution, other: Solution) -> float:
    """Largest angle between the axes of a hole in two fits."""
    pairs = zip(hole_directions(problem, one.parameters), hole_directions(problem, other.parameters), strict=True)
    return float(max(angle_between_rad(a, b) for a, b in pairs))


def _differ(problem: Problem, one: Solution, other: Solution) -> bool:
    return apart_rad(problem, one, other) > float(np.radians(TILT_SEARCH_STAGE.distinct_deg))


def reflected_and_bent(problem: Problem, straight: Solution) -> Solution:
    """The fit with the curvature free from where the tilts of all holes are reflected."""
    freed = replace(problem, free=problem.free | ~STRAIGHT_NAIL)
    start = next(reflections(freed, straight.parameters))
    return minimise(freed, start, COMPARISON_STAGE.most_steps, COMPARISON_STAGE.tolerance, cost_limit_beside(straight))


def cost_limit_beside(best: Solution) -> float:
    """Cost of a pose that is so much worse that it is not followed to its end."""
    return best.cost + 2.0 * COMPARISON_STAGE.abandoned_margin
