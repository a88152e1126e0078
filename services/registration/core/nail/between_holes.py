"""Holes that differ from their file: turned against one another, and beside the nail's axis.

A file states how the holes lie in the nail, and the fit takes that as exact. Holes drilled askew or beside their place,
a display that changed the brightness of one rim, or a thing over it leave each hole with a turn and a shift of its own.
Neither follows from the pose: one Gauss-Newton step estimates them, from the rims of each hole and the nail's edges.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.covariance import further_parameters, share_beyond
from services.registration.core.nail.derivatives import derivatives_by_hole_turns, turns_of_holes
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
