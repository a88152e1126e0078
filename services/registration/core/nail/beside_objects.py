"""The fit beside things in the way: what is darker than the nail is left out, and the rest is fitted.

Metal only ever darkens. An object draws a fit in which it counts to itself, often to the reflected tilt, beside which
parts of the nail are darker as well. So what to leave out is found from the two best tilts, each by a fit in which what
is darker hardly counts. Where the rest looks right with both, the image is ambiguous.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.forward_model import model_at
from services.registration.core.nail.image_fit import ImageFit, disagreement, fit_image, is_plain, is_refused
from services.registration.core.nail.least_squares import (
    LinearSolution,
    Problem,
    estimate_noise,
    linear_solution_at,
    minimise,
    problem_for,
    trimmed,
)
from services.registration.core.nail.left_out import around_holes, beyond_foreign, foreign_in_region, foreign_pixels
from services.registration.core.nail.parameters import STRAIGHT_DISPLAY, prior_mean
from services.registration.core.nail.region import FitInput
from services.registration.core.nail.tilt_ambiguity import poses_beside_objects
from services.registration.core.tuning import FINAL_STAGE, FOREIGN_OBJECTS, TILT_SEARCH_STAGE
from shared.errors import Rejected
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import angle_between_rad
from shared.geometry.parts import NailPart, mean_hole_direction
from shared.geometry.transform import Transform


def shows_an_object(found: ImageFit | Rejected) -> bool:
    """Whether a fit is not plain, and leaves something that is as dark as an object of metal."""
    if isinstance(found, Rejected) or is_plain(found):
        return False
    return found.fit.evidence.residual.darkness >= FOREIGN_OBJECTS.evident_darkness


def fit_beside_objects(
    fit_input: FitInput, start: Transform[Camera, Nail], as_shown: ImageFit | Rejected
) -> ImageFit | Rejected:
    """The fit without what is darker than it or, where that is refused, than a fit of the holes' surroundings.

    Parameters
    ----------
    as_shown
        The fit of the image as it is; returned where nothing is darker.
    """
    nail = fit_input.nail
    _, beside = _without_objects(fit_input, start, as_shown)
    if beside is not as_shown and not is_refused(beside):
        return beside
    seen = _seen_from_the_holes(fit_input, start)
    if seen is None:
        return beside
    _, again = _without_objects(*seen, fit_image(*seen))
    # beside a plate, the whole region had another optimum 16° off
    return beside if isinstance(again, Rejected) or _are_apart(again.fit.camera_from_nail, seen[1], nail) else again


def _without_objects(
    fit_input: FitInput, start: Transform[Camera, Nail], as_shown: ImageFit | Rejected
) -> tuple[FitInput, ImageFit | Rejected]:
    """The fit whose parts agree best, and its input: without what is darker than either of the two best tilts.

    Only where the fit of the image as it is leaves something dark: a nail with smaller holes than its file's is darker
    than the file's nail, and is not one with an object over each rim.
    """
    if isinstance(as_shown, Rejected) or is_plain(as_shown) or not _leaves_something_dark(as_shown):
        return fit_input, as_shown
    poses = poses_beside_objects(fit_input, as_shown.fit.camera_from_nail)
    rounds = [one for pose in poses for one in _rounds(fit_input, start, pose)]
    best_input, best = min([(fit_input, as_shown), *rounds], key=lambda one: (is_refused(one[1]), disagreement(one[1])))
    if isinstance(best, Rejected) or is_refused(best):
        return best_input, best
    accepted = [
        found.fit.camera_from_nail for _, found in rounds if not (isinstance(found, Rejected) or is_refused(found))
    ]
    if any(_are_apart(best.fit.camera_from_nail, other, fit_input.nail) for other in accepted):
        best = _ambiguous(best)
    return best_input, best


def _leaves_something_dark(found: ImageFit) -> bool:
    region, linear = found.end.problem.model.region, found.end.solution.linear
    return bool(np.any(foreign_in_region(region, linear.residual, found.end.noise.variance)))


def _ambiguous(found: ImageFit) -> ImageFit:
    """The same fit without any margin over the reflected tilt."""
    return replace(found, fit=replace(found.fit, evidence=replace(found.fit.evidence, mirror_margin=0.0)))


def _rounds(
    fit_input: FitInput, start: Transform[Camera, Nail], pose: Transform[Camera, Nail]
) -> list[tuple[FitInput, ImageFit | Rejected]]:
    """Fits without what is darker than the nail in a pose, then in the pose that was found; ends with a plain one."""
    rounds: list[tuple[FitInput, ImageFit | Rejected]] = []
    for _ in range(FOREIGN_OBJECTS.most_rounds):
        without = _without_what_is_darker(fit_input, pose)
        if without is None:
            break
        found = fit_image(without, start)
        rounds.append((without, found))
        if isinstance(found, Rejected) or is_plain(found):
            break
        pose = found.fit.camera_from_nail
    return rounds


def _are_apart(one: Transform[Camera, Nail], other: Transform[Camera, Nail], nail: NailPart) -> bool:
    """Whether the hole axes of two poses differ by more than those of one optimum do."""
    axis = mean_hole_direction(nail)
    apart_rad = angle_between_rad(one.directions(axis), other.directions(axis))
    return bool(apart_rad >= np.radians(TILT_SEARCH_STAGE.distinct_deg))


def _seen_from_the_holes(
    fit_input: FitInput, start: Transform[Camera, Nail]
) -> tuple[FitInput, Transform[Camera, Nail]] | None:
    """Input without what is darker than an acceptable fit to the surroundings of the holes alone, and that fit's pose.

    An object along an edge of the nail draws the fit of the whole region to itself; the rims are still as they were.
    What the fit around the holes accepts is not enough: a nail of another width shows at its edges only. None also
    where nothing is darker: the same fit again would be refused again, and an object blamed that is not there.
    """
    around = around_holes(fit_input, start)
    surroundings = fit_input.hiding(~around)
    only, found = _without_objects(surroundings, start, fit_image(surroundings, start))
    if isinstance(found, Rejected) or is_refused(found):
        return None
    pose, covered = found.fit.camera_from_nail, only.occluders.hidden
    whole = fit_input if covered is None else fit_input.hiding(covered & around)
    seen = _without_what_is_darker(whole, pose, around)
    return None if seen is None else (seen, pose)


def _without_what_is_darker(
    fit_input: FitInput, pose: Transform[Camera, Nail], trusted: NDArray[np.bool_] | None = None
) -> FitInput | None:
    """Input without what is darker than the nail in about this pose; None where nothing is, or the holes lie outside.

    Parameters
    ----------
    trusted
        Pixels by which to begin, shape of the image; what lies beyond an object beside the nail is left out then, too.
    """
    model = model_at(fit_input, pose, FINAL_STAGE, 1)
    if model is None:
        return None
    problem = problem_for(model, FINAL_STAGE, STRAIGHT_DISPLAY)
    linear = _begun(problem, model.with_pose(prior_mean(), pose), trusted)
    linear = trimmed(problem, linear, FOREIGN_OBJECTS.trimmed_steps, FINAL_STAGE.tolerance).linear
    variance = estimate_noise(problem, linear).variance
    foreign = foreign_pixels(model.region, linear.residual, variance, fit_input.pixels.shape)
    if trusted is not None:
        foreign |= beyond_foreign(model.region, model.nail, foreign)
    return fit_input.without_objects(foreign)


def _begun(problem: Problem, start: NDArray[np.float64], trusted: NDArray[np.bool_] | None) -> LinearSolution:
    """Where the trimmed fit begins: as given, or at a fit of the trusted pixels, whose background goes on elsewhere."""
    if trusted is None:
        return linear_solution_at(problem, start)
    share = np.where(problem.model.region.compared_in(trusted), 1.0, FOREIGN_OBJECTS.trimmed_weight)
    only = replace(problem, weight=share * problem.weight)
    return minimise(only, start, FOREIGN_OBJECTS.trimmed_steps, FINAL_STAGE.tolerance).linear
