"""The best pose and curvature of a nail whose straight fit leaves a curvature unexplained.

The tilt of each hole has a reflection that looks nearly alike. A straight nail must reflect both at once, and the
divergence of the rays then contradicts it. A bent one can also reflect one of two holes, and a change of curvature
makes up for the divergence: the fit starts from all of these.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.least_squares import Problem, Solution, minimise, minimise_from
from services.registration.core.nail.parameters import CURVATURE, TILTS, Parameter, curvature_of
from services.registration.core.tuning import BENT_NAIL, COMPARISON_STAGE, FINAL_STAGE
from shared.geometry.bend import MM_PER_M
from shared.geometry.lines import angle_between_rad, unit
from shared.geometry.parts import hole_axis


def bent_optimum(problem: Problem, straight: Solution) -> tuple[Solution, float | None] | None:
    """Fit with the curvature free from where the straight fit ended, and from its reflections.

    Returns the best end, and its margin over the next (see `FitEvidence.mirror_margin`) or, without another, None. No
    optimum is found when none is a nail's: canals bend nails to radii of 300 mm and more.
    """
    steps, tolerance = BENT_NAIL.first_steps, FINAL_STAGE.tolerance
    found = [minimise_from(problem, straight.linear, steps, tolerance)]
    for start in reflections(problem, found[0].parameters):
        limit = min(one.cost for one in found) + 2.0 * COMPARISON_STAGE.abandoned_margin
        found.append(minimise(problem, start, steps, tolerance, limit))
    ends = sorted((one for one in found if _is_a_nail(one.parameters)), key=lambda one: one.cost)
    if not ends:
        return None
    others = [one.least_cost for one in found if _differ(problem, one, ends[0])]
    return ends[0], 0.5 * (min(others) - ends[0].cost) if others else None


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
    pitch, rate = float(parameters[Parameter.PITCH_RAD]), float(curvature @ ray) + divergence
    for other_pitch, other_rate, roll in (
        (-pitch, -rate, -1.0),
        (rate * half_mm, pitch / half_mm, 1.0),
        (-rate * half_mm, -pitch / half_mm, 1.0),
    ):
        start = parameters.copy()
        start[TILTS] = other_pitch, roll * parameters[Parameter.ROLL_RAD]
        turned = model.pose(start).rotation
        aside = curvature - float(curvature @ ray) * ray
        start[CURVATURE] = MM_PER_M * ((aside + (other_rate - divergence) * ray) @ turned)[1:]
        yield start


def hole_directions(problem: Problem, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions of the hole axes in the camera's frame, shape (H, 3)."""
    nail = problem.model.nail.bent(curvature_of(parameters))
    axes = np.stack([hole_axis(nail, hole).direction for hole in nail.holes])
    return problem.model.pose(parameters).directions(axes)


def _differ(problem: Problem, one: Solution, other: Solution) -> bool:
    pairs = zip(hole_directions(problem, one.parameters), hole_directions(problem, other.parameters), strict=True)
    return bool(max(angle_between_rad(a, b) for a, b in pairs) > np.radians(BENT_NAIL.distinct_deg))


def _is_a_nail(parameters: NDArray[np.float64]) -> bool:
    return bool(np.hypot(*curvature_of(parameters)) <= MM_PER_M / BENT_NAIL.least_radius_mm)
