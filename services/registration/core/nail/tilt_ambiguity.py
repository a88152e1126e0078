"""From an initial pose to the one optimum that explains the image best, and its margin over the next.

The opening of a bore is the overlap of two nearly equal circles, so that a tilt and its reflection look nearly alike.
On a smoothed and reduced image the likelihood has hardly any optimum but these two, whatever the start: coarse fits
from many tilts find the distinct local optima, and the two best are compared with all nuisance parameters free.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import MIRROR_MARGIN_OF_ONE_HOLE
from services.registration.core.estimation.pose_estimate import POSE_SIZE
from services.registration.core.nail.forward_model import Detail, FitInput, ForwardModel, model_at
from services.registration.core.nail.imaging_chain import Scale
from services.registration.core.nail.least_squares import (
    ALL_PARAMETERS,
    Problem,
    Solution,
    estimate_noise,
    evenly_weighted,
    minimise,
    minimise_from,
    problem_for,
)
from services.registration.core.nail.parameters import PARAMETER_COUNT, Parameter, parameters_from_pose, prior_mean
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import angle_between_rad
from shared.geometry.transform import Transform

_FURTHER_TILTS_RAD = np.radians([(6.0, 6.0), (6.0, -6.0), (-6.0, 6.0), (-6.0, -6.0)])
_DISTINCT_RAD = float(np.radians(1.5))
_SCREENING_STEPS, _MOST_STEPS = 4, 10
_TOLERANCE = 2.0
_MOST_RESTARTS = 3
POSE_ONLY = np.arange(PARAMETER_COUNT) < POSE_SIZE
ANCHORS_ONLY = np.arange(PARAMETER_COUNT) < Parameter.PITCH_RAD

_HOLE_PX_TO_CENTRE, _HOLE_PX_TO_CAPTURE = 6.0, 9.0
_CENTRING_STEPS, _WEIGHING_STEPS, _MIDDLE_STEPS, _NEARBY_STEPS = 8, 3, 8, 3
_LOOSE, _TIGHT = 2.0, 0.2
# A rival that costs so much more, half as much again as any limit asks for, need not be followed to its end.
_CLEARLY_WORSE = 2.0 * 1.5 * MIRROR_MARGIN_OF_ONE_HOLE.limit.value
_TILTS = [Parameter.PITCH_RAD, Parameter.ROLL_RAD]
_NEARBY_RAD = np.radians([(3.0, 0.0), (-3.0, 0.0), (0.0, 3.0), (0.0, -3.0)])


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """An end of a fit, with the direction of the nail's z axis in the camera frame."""

    solution: Solution
    z_camera: NDArray[np.float64]


def local_optima(problem: Problem, start: NDArray[np.float64]) -> list[Optimum]:
    """Optima of pose alone, best first, any two of them at least 1.5° apart.

    Parameters
    ----------
    start
        Pose parameters, shape (6,): tried as it is, with either tilt or both reflected, and with tilts of ±6°.
    """
    under_way = [_optimum_from(problem, _at_tilt(start, tilt), _SCREENING_STEPS) for tilt in _starting_tilts(start)]
    # ways that have met go on as one
    found = [_resumed(problem, optimum) for optimum in distinct(under_way)]
    best = min(found, key=lambda o: o.solution.cost)
    reflected = best.solution.parameters.copy()
    reflected[[Parameter.PITCH_RAD, Parameter.ROLL_RAD]] *= -1.0
    found.append(_optimum_from(problem, reflected, _MOST_STEPS))
    return distinct(found)


def distinct(found: list[Optimum]) -> list[Optimum]:
    """Best first, leaving out whatever lies within 1.5° of a better one."""
    kept: list[Optimum] = []
    for candidate in sorted(found, key=lambda o: o.solution.cost):
        if all(angle_between_rad(candidate.z_camera, other.z_camera) > _DISTINCT_RAD for other in kept):
            kept.append(candidate)
    return kept


def converged_optimum(
    end: Optimum, search_nearby: Callable[[Optimum], Optimum], resume: Callable[[Optimum], Optimum]
) -> tuple[Optimum, float]:
    """Follow an end of a fit to where nothing nearby costs less; that optimum, and the cost of the next.

    If the tilt costs less elsewhere, the fit had not ended in an optimum: balls over a hole had stopped it. The search
    goes on from there. Ends left behind stay rivals; a search that does not come to rest has no margin at all.

    Parameters
    ----------
    search_nearby
        The best fit with the tilt held some degrees away.
    resume
        The end of a fit from there with everything free.
    """
    ends = [end]
    for _ in range(_MOST_RESTARTS + 1):
        nearby = search_nearby(ends[-1])
        best, *others = distinct(ends)
        if nearby.solution.cost >= best.solution.cost:
            return best, min([nearby.solution.least_cost, *(other.solution.least_cost for other in others)])
        ends.append(resume(nearby))
    best = min(ends, key=lambda o: o.solution.cost)
    return best, best.solution.cost


def optimum_of(model: ForwardModel, solution: Solution) -> Optimum:
    """Attach the direction that tells optima apart."""
    return Optimum(solution, model.pose(solution.parameters).rotation[:, 2])


def _starting_tilts(start: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    own = start[[Parameter.PITCH_RAD, Parameter.ROLL_RAD]]
    if np.linalg.norm(own) < _DISTINCT_RAD:
        return [own, *_FURTHER_TILTS_RAD]
    return [own, -own, *_FURTHER_TILTS_RAD]


def _at_tilt(start: NDArray[np.float64], tilt: NDArray[np.float64]) -> NDArray[np.float64]:
    parameters = prior_mean()
    parameters[:POSE_SIZE] = start
    parameters[[Parameter.PITCH_RAD, Parameter.ROLL_RAD]] = tilt
    return parameters


def _optimum_from(problem: Problem, start: NDArray[np.float64], most_steps: int) -> Optimum:
    return optimum_of(problem.model, minimise(problem, start, most_steps, _TOLERANCE))


def _resumed(problem: Problem, optimum: Optimum) -> Optimum:
    if optimum.solution.converged:
        return optimum
    solution = minimise_from(problem, optimum.solution.linear, _MOST_STEPS - _SCREENING_STEPS, _TOLERANCE)
    return optimum_of(problem.model, solution)


@dataclass(frozen=True, slots=True, eq=False)
class GlobalOptimum:
    """Best optimum: all parameters, pose, and the margin (see `NailFit.mirror_margin`)."""

    parameters: NDArray[np.float64]
    camera_from_nail: Transform[Camera, Nail]
    margin: float


def find_global_optimum(given: FitInput, start: Transform[Camera, Nail]) -> GlobalOptimum | None:
    """Centre, capture, compare; `None` when the holes turn out to lie outside the image."""
    centred = _centred(given, start)
    poses = [] if centred is None else _local_optima_poses(given, centred)
    return _compared(given, poses) if poses else None


def _centred(given: FitInput, start: Transform[Camera, Nail]) -> Transform[Camera, Nail] | None:
    """Move the nail over its image, tilt as it is, on an image so smooth that 3 mm are a small step."""
    detail = Detail(Scale(_reduction(given, start, _HOLE_PX_TO_CENTRE), 1.5), 6.0, 8.0, 0.005)
    model = model_at(given, start, detail)
    if model is None:
        return None
    problem = problem_for(model, detail, ANCHORS_ONLY)
    return model.pose(minimise(problem, _from_pose(problem, start), _CENTRING_STEPS, _LOOSE).parameters)


def _local_optima_poses(given: FitInput, start: Transform[Camera, Nail]) -> list[Transform[Camera, Nail]]:
    """Poses of the distinct optima on the reduced image, best first."""
    detail = Detail(Scale(_reduction(given, start, _HOLE_PX_TO_CAPTURE), 0.8), 3.5, 4.0, 0.02)
    model = model_at(given, start, detail)
    if model is None:
        return []
    problem = problem_for(model, detail, POSE_ONLY)
    optima = local_optima(problem, parameters_from_pose(start, model.camera, model.anchors))
    return [model.pose(o.solution.parameters) for o in optima]


def _compared(given: FitInput, poses: list[Transform[Camera, Nail]]) -> GlobalOptimum | None:
    """Refine the two best with all nuisances floating."""
    detail = Detail(Scale(2, 0.8), 3.5, 2.0, 0.01)
    model = model_at(given, poses[0], detail)
    if model is None:
        return None
    problem = problem_for(model, detail, ALL_PARAMETERS)
    first = minimise(problem, _from_pose(problem, poses[0]), _WEIGHING_STEPS, _LOOSE)
    # no pixel may weigh less because the first of them does not explain it
    problem = evenly_weighted(problem, estimate_noise(problem, first.linear))
    optima = [optimum_of(model, minimise_from(problem, first.linear, _MIDDLE_STEPS, _TIGHT))]
    for rival in poses[1:2]:
        start = first.parameters.copy()
        start[:POSE_SIZE] = parameters_from_pose(rival, model.camera, model.anchors)
        clearly_worse = optima[0].solution.cost + _CLEARLY_WORSE
        optima.append(optimum_of(model, minimise(problem, start, _MIDDLE_STEPS, _TIGHT, clearly_worse)))
    best, *others = distinct(optima)
    if others:
        runner_up = others[0].solution.least_cost
    else:
        best, runner_up = converged_optimum(best, lambda end: _nearby(problem, end), lambda end: _free(problem, end))
    parameters = best.solution.parameters
    return GlobalOptimum(parameters, model.pose(parameters), 0.5 * (runner_up - best.solution.cost))


def _free(problem: Problem, held: Optimum) -> Optimum:
    """Where a fit with its tilt held ends once it is free."""
    solution = minimise_from(problem, held.solution.linear, _MIDDLE_STEPS, _TIGHT)
    return optimum_of(problem.model, solution)


def _nearby(problem: Problem, best: Optimum) -> Optimum:
    """Best of the fits with the tilt held 3° away in four directions."""
    free = ALL_PARAMETERS.copy()
    free[_TILTS] = False
    held = replace(problem, free=free)
    found = []
    for tilt in _NEARBY_RAD:
        start = best.solution.parameters.copy()
        start[_TILTS] += tilt
        found.append(minimise(held, start, _NEARBY_STEPS, _LOOSE, best.solution.cost + _CLEARLY_WORSE))
    return optimum_of(problem.model, min(found, key=lambda solution: solution.least_cost))


def _from_pose(problem: Problem, pose: Transform[Camera, Nail]) -> NDArray[np.float64]:
    start = prior_mean()
    start[:POSE_SIZE] = parameters_from_pose(pose, problem.model.camera, problem.model.anchors)
    return start


def _reduction(given: FitInput, start: Transform[Camera, Nail], hole_px: float) -> int:
    """Reduction after which the smallest hole is about `hole_px` pixels wide."""
    scale = given.calibration.camera.focal_length_px / float(start.translation_mm[2])
    smallest = min(h.diameter_mm for h in given.nail.holes)
    return max(2, round(smallest * scale / hole_px))
