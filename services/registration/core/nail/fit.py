"""Fit the nail's pose to the pixels by maximum likelihood, with its covariance and the evidence for its acceptance.

`docs/nail-likelihood.md` has the model, the alternatives and their measured gains.
"""

from dataclasses import replace

import numpy as np

from services.registration.core.acceptance.image import fit_reasons
from services.registration.core.nail.beside_objects import fit_beside_objects, shows_an_object
from services.registration.core.nail.display_curve import display_curve_of
from services.registration.core.nail.evidence import covariance_of_turns
from services.registration.core.nail.image_fit import (
    ImageFit,
    NailFit,
    disagreement,
    fit_image,
    is_plain,
    is_refused,
)
from services.registration.core.nail.region import FitInput
from services.registration.core.tuning import DISPLAY_CURVE
from shared.errors import Accepted, Rejected
from shared.geometry.frames import Camera, Nail
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
    beside = fit_beside_objects(fit_input, start, first) if shows_an_object(first) else None
    if beside is not None and is_plain(beside):
        return beside, beside
    found = _without_display_curve(fit_input, first)
    if not is_refused(found):
        return first, found
    beside = fit_beside_objects(fit_input, start, first) if beside is None else beside
    return beside, beside


def _without_display_curve(fit_input: FitInput, as_shown: ImageFit | Rejected) -> ImageFit | Rejected:
    """The fit without the display's curve, where parts of the image disagree and that makes them agree better."""
    best = found = as_shown
    for _ in range(DISPLAY_CURVE.most_rounds):
        if isinstance(found, Rejected) or disagreement(found) < DISPLAY_CURVE.least_error_ratio:
            break
        curve = display_curve_of(found.end.solution.linear, fit_input.pixels)
        if found is as_shown and curve.explained_share < DISPLAY_CURVE.least_explained_share:
            break
        fit_input = replace(fit_input, pixels=curve.undone(fit_input.pixels))
        found = fit_image(fit_input, found.fit.camera_from_nail)
        largest = min(DISPLAY_CURVE.remaining_share * disagreement(best), DISPLAY_CURVE.largest_error_ratio)
        if disagreement(found) < largest:
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


def measure_nail(fit_input: FitInput, start: Transform[Camera, Nail]) -> Accepted[NailFit] | Rejected:
    """The same without acceptance criteria; rejected only when the holes are not in the image."""
    first = fit_image(fit_input, start)
    found = _without_display_curve(fit_input, first)
    return found if isinstance(found, Rejected) else Accepted(_grown_by_curve(fit_input, first, found))
