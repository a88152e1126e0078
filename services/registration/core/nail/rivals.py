"""From a rough start to the one optimum that explains the image best, and by how much it beats the next."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.capture import (
    ANCHORS_ONLY,
    POSE_ONLY,
    Optimum,
    brought_to_rest,
    distinct_optima,
    optimum_of,
    without_repetition,
)
from services.registration.core.nail.equations import Problem
from services.registration.core.nail.judgement import LEAST_MARGIN_OF_ONE_HOLE
from services.registration.core.nail.pose import POSE_SIZE, parameters_from_pose
from services.registration.core.nail.solver import minimise, minimise_from
from services.registration.core.nail.stages import (
    EVERYTHING,
    Detail,
    Given,
    evenly_weighted,
    noise_of,
    problem_for,
    scene_at,
)
from services.registration.core.nail.unknowns import Unknown, prior_mean
from services.registration.core.nail.window import Scale
from shared.geometry.frames import Camera, Nail
from shared.geometry.transform import Transform

_HOLE_PX_TO_CENTRE, _HOLE_PX_TO_CAPTURE = 6.0, 9.0
_CENTRING_STEPS, _WEIGHING_STEPS, _MIDDLE_STEPS, _NEARBY_STEPS = 8, 3, 8, 3
_LOOSE, _TIGHT = 2.0, 0.2
# A rival that costs so much more, half as much again as any limit asks for, need not be followed to its end.
_CLEARLY_WORSE = 2.0 * 1.5 * LEAST_MARGIN_OF_ONE_HOLE
_TILTS = [Unknown.PITCH_RAD, Unknown.ROLL_RAD]
_NEARBY_RAD = np.radians([(3.0, 0.0), (-3.0, 0.0), (0.0, 3.0), (0.0, -3.0)])


@dataclass(frozen=True, slots=True, eq=False)
class Winner:
    """Best optimum: all parameters, pose, and the margin (see `NailFit.mirror_margin`)."""

    parameters: NDArray[np.float64]
    camera_from_nail: Transform[Camera, Nail]
    margin: float


def find_winner(given: Given, start: Transform[Camera, Nail]) -> Winner | None:
    """Centre, capture, compare; `None` when the holes turn out to lie outside the image."""
    centred = _centred(given, start)
    poses = [] if centred is None else _captured(given, centred)
    return _compared(given, poses) if poses else None


def _centred(given: Given, start: Transform[Camera, Nail]) -> Transform[Camera, Nail] | None:
    """Move the nail over its image, tilt as it is, on an image so smooth that 3 mm are a small step."""
    detail = Detail(Scale(_reduction(given, start, _HOLE_PX_TO_CENTRE), 1.5), 6.0, 8.0, 0.005)
    scene = scene_at(given, start, detail)
    if scene is None:
        return None
    problem = problem_for(scene, detail, ANCHORS_ONLY)
    return scene.pose(minimise(problem, _from_pose(problem, start), _CENTRING_STEPS, _LOOSE).parameters)


def _captured(given: Given, start: Transform[Camera, Nail]) -> list[Transform[Camera, Nail]]:
    """Poses of the distinct optima on the reduced image, best first."""
    detail = Detail(Scale(_reduction(given, start, _HOLE_PX_TO_CAPTURE), 0.8), 3.5, 4.0, 0.02)
    scene = scene_at(given, start, detail)
    if scene is None:
        return []
    problem = problem_for(scene, detail, POSE_ONLY)
    optima = distinct_optima(problem, parameters_from_pose(start, scene.camera, scene.anchors))
    return [scene.pose(o.solution.parameters) for o in optima]


def _compared(given: Given, poses: list[Transform[Camera, Nail]]) -> Winner | None:
    """Refine the two best with all nuisances floating."""
    detail = Detail(Scale(2, 0.8), 3.5, 2.0, 0.01)
    scene = scene_at(given, poses[0], detail)
    if scene is None:
        return None
    problem = problem_for(scene, detail, EVERYTHING)
    first = minimise(problem, _from_pose(problem, poses[0]), _WEIGHING_STEPS, _LOOSE)
    # no pixel may weigh less because the first of them does not explain it
    problem = evenly_weighted(problem, noise_of(problem, first.linear))
    optima = [optimum_of(scene, minimise_from(problem, first.linear, _MIDDLE_STEPS, _TIGHT))]
    for rival in poses[1:2]:
        start = first.parameters.copy()
        start[:POSE_SIZE] = parameters_from_pose(rival, scene.camera, scene.anchors)
        clearly_worse = optima[0].solution.cost + _CLEARLY_WORSE
        optima.append(optimum_of(scene, minimise(problem, start, _MIDDLE_STEPS, _TIGHT, clearly_worse)))
    best, *others = without_repetition(optima)
    if others:
        runner_up = others[0].solution.least_cost
    else:
        best, runner_up = brought_to_rest(best, lambda end: _nearby(problem, end), lambda end: _free(problem, end))
    parameters = best.solution.parameters
    return Winner(parameters, scene.pose(parameters), 0.5 * (runner_up - best.solution.cost))


def _free(problem: Problem, held: Optimum) -> Optimum:
    """Where a fit with its tilt held ends once it is free."""
    solution = minimise_from(problem, held.solution.linear, _MIDDLE_STEPS, _TIGHT)
    return optimum_of(problem.scene, solution)


def _nearby(problem: Problem, best: Optimum) -> Optimum:
    """Best of the fits with the tilt held 3° away in four directions."""
    free = EVERYTHING.copy()
    free[_TILTS] = False
    held = replace(problem, free=free)
    found = []
    for tilt in _NEARBY_RAD:
        start = best.solution.parameters.copy()
        start[_TILTS] += tilt
        found.append(minimise(held, start, _NEARBY_STEPS, _LOOSE, best.solution.cost + _CLEARLY_WORSE))
    return optimum_of(problem.scene, min(found, key=lambda solution: solution.least_cost))


def _from_pose(problem: Problem, pose: Transform[Camera, Nail]) -> NDArray[np.float64]:
    start = prior_mean()
    start[:POSE_SIZE] = parameters_from_pose(pose, problem.scene.camera, problem.scene.anchors)
    return start


def _reduction(given: Given, start: Transform[Camera, Nail], hole_px: float) -> int:
    """Reduction after which the smallest hole is about `hole_px` pixels wide."""
    scale = given.calibration.camera.focal_length_px / float(start.translation_mm[2])
    smallest = min(h.diameter_mm for h in given.nail.holes)
    return max(2, round(smallest * scale / hole_px))
