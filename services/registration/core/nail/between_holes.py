"""Holes that differ from their file: turned against one another, beside the nail's axis, and bored twice.

A file states how the holes lie in the nail, and the fit takes that as exact. Holes drilled askew or beside their place,
a display that changed the brightness of one rim, or a thing over it leave each hole with a turn and a shift of its own.
A drill that went through a hole in vain, askew, leaves two bores. None of this follows from the pose: one Gauss-Newton
step estimates it, from the rims of each hole and the nail's edges.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import POSE_SIZE
from services.registration.core.nail.covariance import further_parameters, share_beyond
from services.registration.core.nail.derivatives import (
    derivatives_by_hole_turns,
    derivatives_by_second_bores,
    turns_of_holes,
)
from services.registration.core.nail.forward_model import trace_transmission, visible_fraction
from services.registration.core.nail.least_squares import LinearSolution, Problem, Solution, with_changes
from services.registration.core.nail.noise import NoiseModel
from services.registration.core.tuning import MODEL_ERRORS, NAIL_AS_BUILT
from shared.geometry.lines import Line
from shared.geometry.parts import NailPart, across_holes

# Step of the derivative by a hole's place: rims are many times softer.
_STEP_MM = 0.02


def turns_between_holes(problem: Problem, solution: Solution, noise: NoiseModel) -> NDArray[np.float64]:
    """Mean square of the holes' own turns across their axes, beyond what noise explains, in rad², shape (2, 2).

    Zero for a nail with one hole; holes which lie as filed hardly count.
    """
    holes = len(problem.model.nail.holes)
    if holes == 1:
        return np.zeros((2, 2))
    precision = np.radians(NAIL_AS_BUILT.usual_turn_sd_deg) ** -2
    derivatives = derivatives_by_hole_turns(solution.linear.model, solution.linear.traced)
    turned = with_changes(problem, solution, derivatives, precision)
    own = turns_of_holes(holes)
    by_model = np.radians(MODEL_ERRORS.tilt_deg) ** 2 * np.linalg.inv(own.T @ own)
    found, covariance = further_parameters(problem, turned, noise, len(derivatives), precision)
    share = share_beyond(found, covariance + np.kron(by_model, np.eye(2)))
    turns = own @ found.reshape(holes - 1, 2)
    return np.asarray(share * turns.T @ turns / holes)


def spread_of_holes_mm(problem: Problem, solution: Solution, noise: NoiseModel) -> float:
    """Standard deviation of the holes' places about their file's beside the nail's axis, beyond noise.

    The nail's edges show where its axis is. How far holes lie along the nail from where the file has them does not show
    beside the nail's depth, which follows from their distance; what made them err beside the axis does so along it.
    """
    holes, precision = len(problem.model.nail.holes), NAIL_AS_BUILT.usual_place_sd_mm**-2
    shifted = with_changes(problem, solution, _derivatives_by_hole_shifts(solution.linear), precision)
    found, covariance = further_parameters(problem, shifted, noise, holes, precision)
    share = share_beyond(found, covariance + MODEL_ERRORS.position_mm**2 * np.eye(holes))
    return float(np.sqrt(share * np.mean(found**2)))


def turns_by_second_bores(problem: Problem, solution: Solution, noise: NoiseModel) -> NDArray[np.float64]:
    """Mean square of the turn (rad²) from the fit to the holes as filed, where they look bored twice, shape (2, 2).

    The filed bore is one of two, which lie either side of their mean, and the image does not say which. The mean is not
    where the fit of single bores ended. Both count by the share of the fall of chi-square that is beyond noise, of
    which a direction and an angle for each hole explain one each.
    """
    bores = _second_bores(problem, solution)
    fall, by_noise = bores.fall / float(noise.inflation.mean()), 2.0 * len(bores.turns_rad)
    share = 1.0 - by_noise / max(fall, by_noise)
    either_side = bores.turns_rad.T @ bores.turns_rad / len(bores.turns_rad)
    return np.asarray(share * (either_side + np.outer(bores.mean_turn_rad, bores.mean_turn_rad)))


@dataclass(frozen=True, slots=True, eq=False)
class _SecondBores:
    """Two bores in each hole, as they explain the image best.

    Attributes
    ----------
    turns_rad
        Of one of them from their mean, about both directions of `across_holes`, shape (H, 2); zero for a hole with one.
    mean_turn_rad
        Of the mean of both from the fit of single bores, common to the holes, shape (2,).
    fall
        Of chi-square by them, of independent noise.
    """

    turns_rad: NDArray[np.float64]
    mean_turn_rad: NDArray[np.float64]
    fall: float


def _second_bores(problem: Problem, solution: Solution) -> _SecondBores:
    """The best of some directions in each hole, or none in it, by one Gauss-Newton step of all parameters."""
    nail, count = problem.model.nail, NAIL_AS_BUILT.second_bore_directions
    angle = np.pi / count * np.arange(count)
    directions = np.column_stack([np.cos(angle), np.sin(angle)])
    derivatives = derivatives_by_second_bores(solution.linear.model, solution.linear.traced, directions)
    precision = np.radians(NAIL_AS_BUILT.usual_turn_sd_deg) ** -2
    equations = with_changes(problem, solution, derivatives, precision).equations
    matrix, gradient = equations.matrix, equations.gradient
    free = np.arange(len(gradient) - len(derivatives))
    without = float(gradient[free] @ np.linalg.solve(matrix[np.ix_(free, free)], gradient[free]))
    motion = across_holes(nail) @ problem.model.motion_by_parameters(solution.parameters)[:3]
    best = _SecondBores(np.zeros((len(nail.holes), 2)), np.zeros(2), 0.0)
    for chosen in product(range(-1, count), repeat=len(nail.holes)):
        holes = [hole for hole, direction in enumerate(chosen) if direction >= 0]
        rows = np.append(free, [len(free) + count * hole + chosen[hole] for hole in holes]).astype(int)
        step = np.linalg.solve(matrix[np.ix_(rows, rows)], gradient[rows])
        fall = float(gradient[rows] @ step) - without
        if fall > best.fall and np.all(step[len(free) :] > 0.0):
            turns = np.zeros((len(nail.holes), 2))
            turns[holes] = step[len(free) :, None] * directions[[chosen[hole] for hole in holes]]
            best = _SecondBores(turns, motion @ step[:POSE_SIZE], fall)
    return best


def _derivatives_by_hole_shifts(here: LinearSolution) -> list[NDArray[np.float64]]:
    """Derivatives of `visible_fraction` by each hole's place beside the nail's axis (mm), the nail held, (N,) each."""

    def by_shift(index: int) -> NDArray[np.float64]:
        model = replace(here.model, nail=_with_hole_aside(here.model.nail, index))
        visible = visible_fraction(model, trace_transmission(model, here.traced.parameters))
        return np.asarray((visible - here.visible) / _STEP_MM)

    return [by_shift(index) for index in range(len(here.model.nail.holes))]


def _with_hole_aside(nail: NailPart, index: int) -> NailPart:
    holes, aside = list(nail.holes), across_holes(nail)[1]
    axis = holes[index].axis
    holes[index] = replace(holes[index], axis=Line(axis.point_mm + _STEP_MM * aside, axis.direction))
    return replace(nail, holes=tuple(holes))
