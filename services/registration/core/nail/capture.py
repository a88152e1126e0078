"""Which tilts the image allows: coarse fits from many tilts, and the distinct optima they end in.

The opening of a bore is the overlap of two nearly equal circles, so that a tilt and its reflection look nearly alike.
On a smoothed and reduced image the likelihood has hardly any optimum but these two, whatever the start.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.equations import Problem
from services.registration.core.nail.pose import POSE_SIZE
from services.registration.core.nail.scene import NailScene
from services.registration.core.nail.solver import Solution, minimise, minimise_from
from services.registration.core.nail.unknowns import PARAMETERS, Unknown, prior_mean
from shared.geometry.lines import angle_between_rad

_FURTHER_TILTS_RAD = np.radians([(6.0, 6.0), (6.0, -6.0), (-6.0, 6.0), (-6.0, -6.0)])
_DISTINCT_RAD = float(np.radians(1.5))
_SCREENING_STEPS, _MOST_STEPS = 4, 10
_TOLERANCE = 2.0
_MOST_RESTARTS = 3
POSE_ONLY = np.arange(PARAMETERS) < POSE_SIZE
ANCHORS_ONLY = np.arange(PARAMETERS) < Unknown.PITCH_RAD


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """An end of a fit, with the direction of the nail's z axis in the camera frame."""

    solution: Solution
    z_camera: NDArray[np.float64]


def distinct_optima(problem: Problem, start: NDArray[np.float64]) -> list[Optimum]:
    """Optima of pose alone, best first, any two of them at least 1.5° apart.

    Parameters
    ----------
    start
        Pose parameters, shape (6,): tried as it is, with either tilt or both reflected, and with tilts of ±6°.
    """
    under_way = [_optimum(problem, _with_tilt(start, tilt), _SCREENING_STEPS) for tilt in _starting_tilts(start)]
    # ways that have met go on as one
    found = [_carried_on(problem, optimum) for optimum in without_repetition(under_way)]
    best = min(found, key=lambda o: o.solution.cost)
    reflected = best.solution.parameters.copy()
    reflected[[Unknown.PITCH_RAD, Unknown.ROLL_RAD]] *= -1.0
    found.append(_optimum(problem, reflected, _MOST_STEPS))
    return without_repetition(found)


def without_repetition(found: list[Optimum]) -> list[Optimum]:
    """Best first, leaving out whatever lies within 1.5° of a better one."""
    kept: list[Optimum] = []
    for candidate in sorted(found, key=lambda o: o.solution.cost):
        if all(angle_between_rad(candidate.z_camera, other.z_camera) > _DISTINCT_RAD for other in kept):
            kept.append(candidate)
    return kept


def brought_to_rest(
    end: Optimum, look_nearby: Callable[[Optimum], Optimum], go_on: Callable[[Optimum], Optimum]
) -> tuple[Optimum, float]:
    """Follow an end of a fit to where nothing nearby costs less; that optimum, and the cost of the next.

    If the tilt costs less elsewhere, the fit had not ended in an optimum: balls over a hole had stopped it. The search
    goes on from there. Ends left behind stay rivals; a search that does not come to rest has no margin at all.

    Parameters
    ----------
    look_nearby
        The best fit with the tilt held some degrees away.
    go_on
        The end of a fit from there with everything free.
    """
    ends = [end]
    for _ in range(_MOST_RESTARTS + 1):
        nearby = look_nearby(ends[-1])
        best, *others = without_repetition(ends)
        if nearby.solution.cost >= best.solution.cost:
            return best, min([nearby.solution.least_cost, *(other.solution.least_cost for other in others)])
        ends.append(go_on(nearby))
    best = min(ends, key=lambda o: o.solution.cost)
    return best, best.solution.cost


def optimum_of(scene: NailScene, solution: Solution) -> Optimum:
    """Attach the direction that tells optima apart."""
    return Optimum(solution, scene.pose(solution.parameters).rotation[:, 2])


def _starting_tilts(start: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    own = start[[Unknown.PITCH_RAD, Unknown.ROLL_RAD]]
    if np.linalg.norm(own) < _DISTINCT_RAD:
        return [own, *_FURTHER_TILTS_RAD]
    return [own, -own, *_FURTHER_TILTS_RAD]


def _with_tilt(start: NDArray[np.float64], tilt: NDArray[np.float64]) -> NDArray[np.float64]:
    parameters = prior_mean()
    parameters[:POSE_SIZE] = start
    parameters[[Unknown.PITCH_RAD, Unknown.ROLL_RAD]] = tilt
    return parameters


def _optimum(problem: Problem, start: NDArray[np.float64], most_steps: int) -> Optimum:
    return optimum_of(problem.scene, minimise(problem, start, most_steps, _TOLERANCE))


def _carried_on(problem: Problem, optimum: Optimum) -> Optimum:
    if optimum.solution.converged:
        return optimum
    solution = minimise_from(problem, optimum.solution.linear, _MOST_STEPS - _SCREENING_STEPS, _TOLERANCE)
    return optimum_of(problem.scene, solution)
