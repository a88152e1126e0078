"""From an initial pose to the one optimum that explains the image best, and its margin over the next.

The opening of a bore is the overlap of two nearly equal circles, so that a tilt and its reflection look nearly alike.
On a smoothed and reduced image the likelihood has hardly any optimum but these two, whatever the start: coarse fits
from many tilts find the distinct local optima, and the two best are compared with all nuisance parameters free.

A straight nail reflects the tilts of both holes at once. The bent nail that looks most like its reflection is compared,
too; what comes of that is decided at full resolution (`bent_nail`).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.bent_nail import cost_limit_beside, reflected_and_bent
from services.registration.core.nail.forward_model import model_at, reduced_model
from services.registration.core.nail.least_squares import (
    Problem,
    Solution,
    estimate_noise,
    evenly_weighted,
    minimise,
    minimise_from,
    problem_for,
    trimmed,
)
from services.registration.core.nail.parameters import (
    PARAMETER_COUNT,
    POSE_ONLY,
    STRAIGHT_NAIL,
    TILTS,
    Parameter,
    level_tilts,
    prior_mean,
)
from services.registration.core.nail.region import FitInput
from services.registration.core.tuning import (
    CENTRING_STAGE,
    COMPARISON_STAGE,
    FOREIGN_OBJECTS,
    NAIL_SOLVER,
    TILT_SEARCH_STAGE,
)
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import angle_between_rad
from shared.geometry.transform import Transform

_ANCHORS_ONLY = np.arange(PARAMETER_COUNT) < Parameter.PITCH_RAD
_DIAGONALS = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)])
_AXES = np.array([(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])


@dataclass(frozen=True, slots=True, eq=False)
class GlobalOptimum:
    """Best optimum of a straight nail.

    Attributes
    ----------
    parameters, camera_from_nail
        All parameters, and the pose.
    margin
        Over other poses of a straight nail (see `FitEvidence.mirror_margin`).
    bent_margin
        The same over the reflected pose of a nail that is bent as the rays diverge: such a nail looks nearly alike.
    """

    parameters: NDArray[np.float64]
    camera_from_nail: Transform[Camera, Nail]
    margin: float
    bent_margin: float


def find_global_optimum(fit_input: FitInput, start: Transform[Camera, Nail]) -> GlobalOptimum | None:
    """Centre the nail, search its tilts, compare the best; `None` when the holes lie outside the image."""
    centred = _centred(fit_input, start)
    poses = [] if centred is None else _optimal_poses(fit_input, centred)
    return _compared(fit_input, poses) if poses else None


def _centred(fit_input: FitInput, start: Transform[Camera, Nail]) -> Transform[Camera, Nail] | None:
    """Move the nail over its image with its tilt held."""
    model = reduced_model(fit_input, start, CENTRING_STAGE, CENTRING_STAGE.hole_width_px)
    if model is None:
        return None
    problem = problem_for(model, CENTRING_STAGE, _ANCHORS_ONLY)
    initial = model.with_pose(prior_mean(), start)
    return model.pose(minimise(problem, initial, CENTRING_STAGE.most_steps, NAIL_SOLVER.coarse_tolerance).parameters)


def _optimal_poses(fit_input: FitInput, start: Transform[Camera, Nail]) -> list[Transform[Camera, Nail]]:
    """Poses of the distinct local optima on the reduced image, best first."""
    model = reduced_model(fit_input, start, TILT_SEARCH_STAGE, TILT_SEARCH_STAGE.hole_width_px)
    if model is None:
        return []
    optima = local_optima(problem_for(model, TILT_SEARCH_STAGE, POSE_ONLY), model.with_pose(prior_mean(), start))
    return [model.pose(optimum.parameters) for optimum in optima]


def poses_beside_objects(fit_input: FitInput, start: Transform[Camera, Nail]) -> list[Transform[Camera, Nail]]:
    """The best pose on the reduced image when what is darker hardly counts, and the next if it explains as much.

    Empty when the holes lie outside the image.
    """
    stage = TILT_SEARCH_STAGE
    model = reduced_model(fit_input, start, stage, stage.hole_width_px)
    if model is None:
        return []
    problem, initial = problem_for(model, stage, POSE_ONLY), model.with_pose(prior_mean(), start)

    def found_from(tilt: NDArray[np.float64]) -> Solution:
        begun = minimise(problem, _tilted(initial, tilt), stage.screening_steps, NAIL_SOLVER.coarse_tolerance)
        return trimmed(problem, begun.linear, stage.screening_steps, NAIL_SOLVER.coarse_tolerance)

    best, *others = distinct([found_from(tilt) for tilt in _starting_tilts(initial, level_tilts(model.nail))])
    # with the noise estimated from what each leaves, the logarithm of the likelihood ratio is N/2 log(cost/cost)
    largest = best.cost * np.exp(2.0 * FOREIGN_OBJECTS.clear_margin / len(problem.weight))
    return [model.pose(one.parameters) for one in (best, *others[:1]) if one.cost < largest]


def local_optima(problem: Problem, start: NDArray[np.float64]) -> list[Solution]:
    """Distinct optima of pose alone, best first.

    Parameters
    ----------
    start
        All parameters, shape (PARAMETER_COUNT,); the tilt of the holes is tried as it is, reflected, and with ±6° of
        pitch and roll.
    """
    stage, level = TILT_SEARCH_STAGE, level_tilts(problem.model.nail)
    searches = [
        minimise(problem, _tilted(start, tilt), stage.screening_steps, NAIL_SOLVER.coarse_tolerance)
        for tilt in _starting_tilts(start, level)
    ]
    # searches that have converged to the same pose are merged
    found = [_resumed(problem, search) for search in distinct(searches)]
    best = min(found, key=lambda solution: solution.cost)
    reflected = _tilted(best.parameters, 2.0 * level - best.parameters[TILTS])
    found.append(minimise(problem, reflected, stage.most_steps, NAIL_SOLVER.coarse_tolerance))
    return distinct(found)


def distinct(found: list[Solution]) -> list[Solution]:
    """Best first, leaving out whatever lies within 1.5° of a better one."""
    kept: list[Solution] = []
    least_rad = np.radians(TILT_SEARCH_STAGE.distinct_deg)
    for candidate in sorted(found, key=lambda solution: solution.cost):
        directions = (other.hole_direction_camera for other in kept)
        if all(angle_between_rad(candidate.hole_direction_camera, other) > least_rad for other in directions):
            kept.append(candidate)
    return kept


def _starting_tilts(start: NDArray[np.float64], level: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    own, further = start[TILTS], level + np.radians(TILT_SEARCH_STAGE.further_tilt_deg * _DIAGONALS)
    if np.linalg.norm(own - level) < np.radians(TILT_SEARCH_STAGE.distinct_deg):
        return [own, *further]
    return [own, 2.0 * level - own, *further]


def _tilted(parameters: NDArray[np.float64], tilt: NDArray[np.float64]) -> NDArray[np.float64]:
    tilted = parameters.copy()
    tilted[TILTS] = tilt
    return tilted


def _resumed(problem: Problem, search: Solution) -> Solution:
    if search.converged:
        return search
    steps = TILT_SEARCH_STAGE.most_steps - TILT_SEARCH_STAGE.screening_steps
    return minimise_from(problem, search.linear, steps, NAIL_SOLVER.coarse_tolerance)


def _compared(fit_input: FitInput, poses: list[Transform[Camera, Nail]]) -> GlobalOptimum | None:
    """Refine the two best with all nuisance parameters free."""
    stage = COMPARISON_STAGE
    model = model_at(fit_input, poses[0], stage, stage.reduction)
    if model is None:
        return None
    problem = problem_for(model, stage, STRAIGHT_NAIL)
    first = minimise(problem, model.with_pose(prior_mean(), poses[0]), stage.noise_steps, NAIL_SOLVER.coarse_tolerance)
    # no pixel may weigh less because the first of them does not explain it
    problem = evenly_weighted(problem, estimate_noise(problem, first.linear))
    optima = [minimise_from(problem, first.linear, stage.most_steps, stage.tolerance)]
    for pose in poses[1:2]:
        start, cost_limit = model.with_pose(first.parameters, pose), cost_limit_beside(optima[0])
        optima.append(minimise(problem, start, stage.most_steps, stage.tolerance, cost_limit))
    best, *others = distinct(optima)
    if others:
        next_cost = others[0].least_cost
    else:
        best, next_cost = converged_optimum(
            best,
            lambda end: _nearby(problem, end),
            lambda end: minimise_from(problem, end.linear, stage.most_steps, stage.tolerance),
        )
    bent_cost = reflected_and_bent(problem, best).least_cost
    margin, bent_margin = (0.5 * (cost - best.cost) for cost in (next_cost, bent_cost))
    return GlobalOptimum(best.parameters, model.pose(best.parameters), margin, bent_margin)


def converged_optimum(
    end: Solution, search_nearby: Callable[[Solution], Solution], resume: Callable[[Solution], Solution]
) -> tuple[Solution, float]:
    """Follow an end of a fit to where nothing nearby costs less; that optimum, and the cost of the next.

    If the tilt costs less elsewhere, the fit had not converged to an optimum: balls over a hole had stopped it. The
    search resumes there. Ends left behind stay competing poses; a search that does not converge has no margin.

    Parameters
    ----------
    search_nearby
        The best fit with the tilt held some degrees away.
    resume
        The end of a fit from there with all parameters free.
    """
    ends = [end]
    for _ in range(COMPARISON_STAGE.most_restarts + 1):
        nearby = search_nearby(ends[-1])
        best, *others = distinct(ends)
        if nearby.cost >= best.cost:
            return best, min([nearby.least_cost, *(other.least_cost for other in others)])
        ends.append(resume(nearby))
    best = min(ends, key=lambda solution: solution.cost)
    return best, best.cost


def _nearby(problem: Problem, best: Solution) -> Solution:
    """Best of the fits with the tilt held 3° away in four directions."""
    stage, free = COMPARISON_STAGE, STRAIGHT_NAIL.copy()
    free[TILTS] = False
    held = replace(problem, free=free)
    found = [
        minimise(
            held,
            _tilted(best.parameters, best.parameters[TILTS] + tilt),
            stage.nearby_steps,
            NAIL_SOLVER.coarse_tolerance,
            cost_limit_beside(best),
        )
        for tilt in np.radians(stage.nearby_tilt_deg * _AXES)
    ]
    return min(found, key=lambda solution: solution.least_cost)
