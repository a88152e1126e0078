"""Fit the nail's pose to the pixels by maximum likelihood, with its covariance and the evidence for its acceptance.

`docs/nail-likelihood.md` has the model, the alternatives and their measured gains.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.image import fit_reasons
from services.registration.core.nail.display_curve import display_curve_of
from services.registration.core.nail.evidence import covariance_of_turns
from services.registration.core.nail.forward_model import model_at
from services.registration.core.nail.image_fit import FitEnd, ImageFit, NailFit, fit_image
from services.registration.core.nail.least_squares import (
    estimate_noise,
    linear_solution_at,
    problem_for,
)
from services.registration.core.nail.left_out import around_holes, beyond_foreign, foreign_pixels
from services.registration.core.nail.parameters import (
    STRAIGHT_DISPLAY,
)
from services.registration.core.nail.region import FitInput
from services.registration.core.tuning import DISPLAY_CURVE, FINAL_STAGE, FOREIGN_OBJECTS, TILT_SEARCH_STAGE
from shared.errors import Accepted, Rejected
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import angle_between_rad
from shared.geometry.parts import NailPart, mean_hole_direction
from shared.geometry.transform import Transform


def fit_nail(fit_input: FitInput, start: Transform[Camera, Nail]) -> Accepted[NailFit] | Rejected:
    """Estimate the nail's pose from a start within about 5° and 3 mm across, and accept or reject it.

    Parameters
    ----------
    start
        Initial pose; its tilt may be the reflected one.

    Returns
    -------
    Accepted[NailFit] or Rejected
        Rejected as `hole_not_visible`, `nail_model_mismatch` or `mirror_ambiguous`.
    """
    first, found = _fits(fit_input, start)
    if isinstance(found, Rejected):
        return found
    reasons = fit_reasons(found.fit.evidence)
    return Rejected(reasons) if reasons else Accepted(_grown_by_curve(fit_input, first, found))


def _fits(fit_input: FitInput, start: Transform[Camera, Nail]) -> tuple[ImageFit | Rejected, ImageFit | Rejected]:
    """The fit of what the image shows, and the one to go by: without the display's curve, or without objects.

    What is far darker than the fit is an object: a curve bent until it explains one leaves a fit that errs and agrees.
    """
    first = fit_image(fit_input, start)
    beside = _without_objects(fit_input, start, first) if _shows_an_object(first) else None
    if beside is not None and _is_plain(beside):
        return beside, beside
    found = _without_display_curve(fit_input, first)
    if not _is_refused(found):
        return first, found
    beside = _without_objects(fit_input, start, first) if beside is None else beside
    return beside, beside


def _shows_an_object(found: ImageFit | Rejected) -> bool:
    """Whether a fit is not plain, and leaves something that is as dark as an object of metal."""
    if isinstance(found, Rejected) or _is_plain(found):
        return False
    return found.fit.evidence.residual.darkness >= FOREIGN_OBJECTS.evident_darkness


def _without_objects(
    fit_input: FitInput, start: Transform[Camera, Nail], first: ImageFit | Rejected
) -> ImageFit | Rejected:
    """The fit without what is darker than it or, where that is refused, than a fit of the holes' surroundings."""
    beside = _fitted_without_foreign_objects(fit_input, start, first)[1]
    if beside is not first and not _is_refused(beside):
        return beside
    seen = _seen_from_the_holes(fit_input, start)
    if seen is None:
        return beside
    again = _beside_objects(_fitted_without_foreign_objects(*seen)[1])
    return again if not isinstance(again, Rejected) and _agrees(again, seen[1], fit_input.nail) else beside


def _agrees(found: ImageFit, camera_from_nail: Transform[Camera, Nail], nail: NailPart) -> bool:
    """Whether a fit has the hole axes of a pose: beside a plate, the whole region had another optimum 16° off."""
    axis = mean_hole_direction(nail)
    apart_rad = angle_between_rad(found.fit.camera_from_nail.directions(axis), camera_from_nail.directions(axis))
    return bool(apart_rad < np.radians(TILT_SEARCH_STAGE.distinct_deg))


def _is_refused(found: ImageFit | Rejected) -> bool:
    return isinstance(found, Rejected) or bool(fit_reasons(found.fit.evidence))


def _is_plain(found: ImageFit | Rejected) -> bool:
    """Whether a fit is acceptable, and its parts agree as those of plain images do."""
    return not _is_refused(found) and _disagreement(found) < DISPLAY_CURVE.least_error_ratio


def _without_display_curve(fit_input: FitInput, as_shown: ImageFit | Rejected) -> ImageFit | Rejected:
    """The fit without the display's curve, where parts of the image disagree and that makes them agree better."""
    best = found = as_shown
    for _ in range(DISPLAY_CURVE.most_rounds):
        if isinstance(found, Rejected) or _disagreement(found) < DISPLAY_CURVE.least_error_ratio:
            break
        curve = display_curve_of(found.end.solution.linear, fit_input.pixels)
        if found is as_shown and curve.explained_share < DISPLAY_CURVE.least_explained_share:
            break
        fit_input = replace(fit_input, pixels=curve.undone(fit_input.pixels))
        found = fit_image(fit_input, found.fit.camera_from_nail)
        largest = min(DISPLAY_CURVE.remaining_share * _disagreement(best), DISPLAY_CURVE.largest_error_ratio)
        if _disagreement(found) < largest:
            best = found
    return best


def _grown_by_curve(fit_input: FitInput, first: ImageFit | Rejected, found: ImageFit) -> NailFit:
    """The fit that was found, its errors grown by the display's curve that is left, where the first fit shows one.

    A curve that turns all parts alike makes none of them disagree, and one that was undone may have been the wrong one.
    """
    if isinstance(first, Rejected):
        first = found
    shown = display_curve_of(first.end.solution.linear, fit_input.pixels)
    if shown.explained_share < DISPLAY_CURVE.least_explained_share:
        return found.fit
    left = shown if found is first else display_curve_of(found.end.solution.linear, fit_input.pixels)
    turn_deg = DISPLAY_CURVE.turn_deg * min(left.change, DISPLAY_CURVE.largest_change)
    square = np.radians(turn_deg) ** 2 * np.eye(2)
    return replace(found.fit, errors=found.fit.errors.with_more(covariance_of_turns(fit_input.nail, square)))


def _disagreement(found: ImageFit | Rejected) -> float:
    return float("inf") if isinstance(found, Rejected) else found.fit.evidence.error_ratio


def _fitted_without_foreign_objects(
    fit_input: FitInput, start: Transform[Camera, Nail], as_shown: ImageFit | Rejected | None = None
) -> tuple[FitInput, ImageFit | Rejected]:
    """Leave out what is darker than the fit and fit again, while the fit is not plain and there is more: the best fit.

    Begins with the fit of the image as it is shown, where that is known.
    """
    found = fit_image(fit_input, start) if as_shown is None else as_shown
    best = fit_input, found
    for _ in range(FOREIGN_OBJECTS.most_rounds):
        if isinstance(found, Rejected) or _is_plain(found):
            break
        without = _without_foreign_objects(fit_input, found.end)
        if without is None:
            break
        fit_input, found = without, _beside_objects(fit_image(without, start))
        if _is_refused(best[1]) or (not _is_refused(found) and _disagreement(found) < _disagreement(best[1])):
            best = fit_input, found
    return best


def _beside_objects(found: ImageFit | Rejected) -> ImageFit | Rejected:
    """The same fit, marked as one from which pixels were left out that are darker than an earlier fit."""
    if isinstance(found, Rejected):
        return found
    evidence = replace(found.fit.evidence, objects_left_out=True)
    return replace(found, fit=replace(found.fit, evidence=evidence))


def _seen_from_the_holes(
    fit_input: FitInput, start: Transform[Camera, Nail]
) -> tuple[FitInput, Transform[Camera, Nail]] | None:
    """Input without what is darker than an acceptable fit to the surroundings of the holes alone, and that fit's pose.

    An object along an edge of the nail draws the fit of the whole region to itself; the rims are still as they were.
    What the fit around the holes accepts is not enough: a nail of another width shows at its edges only. None also
    where nothing is darker: the same fit again would be refused again, and an object blamed that is not there.
    """
    around = around_holes(fit_input, start)
    only, found = _fitted_without_foreign_objects(_hiding(fit_input, ~around), start)
    if isinstance(found, Rejected) or _is_refused(found):
        return None
    pose, covered = found.fit.camera_from_nail, only.occluders.hidden
    whole = fit_input if covered is None else _hiding(fit_input, covered & around)
    model = model_at(whole, pose, FINAL_STAGE, 1)
    if model is None:
        return None
    problem = problem_for(model, FINAL_STAGE, STRAIGHT_DISPLAY)
    linear = linear_solution_at(problem, found.end.solution.parameters)
    variance = estimate_noise(problem, linear).variance
    foreign = foreign_pixels(model.region, linear.residual, variance, fit_input.pixels.shape)
    seen = _hiding(whole, foreign | beyond_foreign(model.region, model.nail, foreign))
    return (seen, pose) if _hides_more(seen, fit_input) else None


def _hiding(fit_input: FitInput, more: NDArray[np.bool_]) -> FitInput:
    hidden = fit_input.occluders.hidden
    return replace(fit_input, occluders=replace(fit_input.occluders, hidden=more if hidden is None else hidden | more))


def _hides_more(one: FitInput, other: FitInput) -> bool:
    hidden, before = one.occluders.hidden, other.occluders.hidden
    return hidden is not None and bool(np.any(hidden if before is None else hidden & ~before))


def measure_nail(fit_input: FitInput, start: Transform[Camera, Nail]) -> Accepted[NailFit] | Rejected:
    """The same without acceptance criteria; rejected only when the holes are not in the image."""
    first = fit_image(fit_input, start)
    found = _without_display_curve(fit_input, first)
    return found if isinstance(found, Rejected) else Accepted(_grown_by_curve(fit_input, first, found))


def _without_foreign_objects(fit_input: FitInput, end: FitEnd) -> FitInput | None:
    """The same input with what is darker than the fit left out; None where there is nothing more."""
    region, residual = end.problem.model.region, end.solution.linear.residual
    without = _hiding(fit_input, foreign_pixels(region, residual, end.noise.variance, fit_input.pixels.shape))
    return without if _hides_more(without, fit_input) else None
