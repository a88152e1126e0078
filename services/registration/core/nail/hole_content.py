"""What is in the nail's holes and about them, which no prior knows: bone, dust, cement, bores of a drill, gas.

The background is a smooth field, but need not continue smoothly through the holes. If it had to, the fit would explain
what is darker or brighter there by the nail: by more metal in the rays' way, and so by another tilt. So the field is
looser about the holes, by as much as the image shows. What determines the pose there are the rims: they are sharper
than its knots can follow. So is the edge of a channel that was drilled through what fills the holes. It shows when the
fit has ended, by one Gauss-Newton step with it.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import POSE_SIZE
from services.registration.core.nail.background import Stiffness, spline_field
from services.registration.core.nail.derivatives import derivatives_by_channels
from services.registration.core.nail.least_squares import (
    LinearSolution,
    Problem,
    Solution,
    linear_solution_from,
    with_changes,
)
from services.registration.core.nail.noise import NoiseModel
from services.registration.core.tuning import FINAL_STAGE, HOLE_CHANNELS, HOLE_CONTENT
from shared.geometry.parts import Hole, NailPart, across_holes, place_of_hole


def loosened(problem: Problem, looser: float = HOLE_CONTENT.looser[0]) -> Problem:
    """The last stage's problem with a background that may vary so many times as much about the holes as elsewhere."""
    region, nail = problem.model.region, problem.model.nail
    field = spline_field(
        region.along_mm, region.across_mm, FINAL_STAGE.knot_spacing_mm, stiffness_about_holes(nail, looser)
    )
    return replace(problem, field=field)


def with_evident_looseness(problem: Problem, here: LinearSolution) -> tuple[Problem, LinearSolution]:
    """The problem whose background is as loose about the holes as makes the image most likely, and its solution."""
    candidates = [loosened(problem, looser) for looser in HOLE_CONTENT.looser]
    solved = [(candidate, linear_solution_from(candidate, here)) for candidate in candidates]
    return min(solved, key=lambda pair: _unlikeliness(*pair))


def _unlikeliness(problem: Problem, here: LinearSolution) -> float:
    """Twice the negative logarithm of the likelihood, whatever background and floor are, up to a constant.

    What a looser field explains better it must explain by more than the greater choice of fields that it has.
    """
    prior = problem.field.log_prior_determinant(problem.texture_precision)
    return here.cost + here.factor.log_determinant - prior


def stiffness_about_holes(nail: NailPart, looser: float) -> Stiffness:
    """Stiffness of the background about a nail: that of other places, but next to its holes."""

    def stiffness(along_mm: NDArray[np.float64], across_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        near = np.any([_is_near(nail, hole, along_mm, across_mm) for hole in nail.holes], axis=0)
        return np.where(near, looser**-2, 1.0)

    return stiffness


def _is_near(
    nail: NailPart, hole: Hole, along_mm: NDArray[np.float64], across_mm: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether places lie within so many radii of a hole's middle (of a slot: half its length and width)."""
    middle_along_mm, middle_across_mm = place_of_hole(nail, hole)
    radius_mm = 0.5 * hole.diameter_mm
    radii = np.hypot(
        (along_mm - middle_along_mm) / (radius_mm + hole.half_slot_mm), (across_mm - middle_across_mm) / radius_mm
    )
    return np.asarray(radii < HOLE_CONTENT.reach_radii)


def turns_by_channels(problem: Problem, solution: Solution, noise: NoiseModel) -> NDArray[np.float64]:
    """Mean square of the turn (rad²) from the fit to one with a channel in what fills the holes, shape (2, 2).

    A channel that was drilled along the beam, or a plug, has an edge inside the rim that is as sharp as that, and turns
    the nail farther than one step leads back. It counts by the share of the fall of chi-square that is beyond noise.
    """
    nail, widths = problem.model.nail, HOLE_CHANNELS.widths
    derivatives = derivatives_by_channels(solution.linear.model, solution.linear.traced, widths)
    equations = with_changes(problem, solution, derivatives, HOLE_CHANNELS.usual_sd**-2).equations
    matrix, gradient = equations.matrix, equations.gradient
    free = np.arange(len(gradient) - len(derivatives))
    without = np.linalg.solve(matrix[np.ix_(free, free)], gradient[free])
    motion = across_holes(nail) @ problem.model.motion_by_parameters(solution.parameters)[:3]
    best_fall, best_turn_rad = 0.0, np.zeros(2)
    for channels in len(free) + np.arange(len(derivatives)).reshape(len(widths), -1):
        rows = np.append(free, channels)
        step = np.linalg.solve(matrix[np.ix_(rows, rows)], gradient[rows])
        fall = float(gradient[rows] @ step - gradient[free] @ without)
        if fall > best_fall:
            best_fall, best_turn_rad = fall, motion @ (step[:POSE_SIZE] - without[:POSE_SIZE])
    fall = best_fall / float(noise.inflation.mean())
    share = 1.0 - HOLE_CHANNELS.by_noise / max(fall, HOLE_CHANNELS.by_noise)
    turn_rad = HOLE_CHANNELS.turn * best_turn_rad
    return np.asarray(share * np.outer(turn_rad, turn_rad))
