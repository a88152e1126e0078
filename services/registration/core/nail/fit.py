"""Fit the nail's pose to the pixels by maximum likelihood, with its covariance and the evidence for its acceptance.

`docs/nail-likelihood.md` has the model, the alternatives and their measured gains.
"""

from dataclasses import dataclass, replace

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
    fits = _fits(fit_input, start)
    if isinstance(fits.chosen, Rejected):
        return fits.chosen
    reasons = fit_reasons(fits.chosen.fit.evidence)
    return Rejected(reasons) if reasons else Accepted(_grown(fit_input, fits.chosen, fits))


def measure_nail(fit_input: FitInput, start: Transform[Camera, Nail]) -> Accepted[NailFit] | Rejected:
    """The same without acceptance criteria; rejected only when the holes are not in the image."""
    fits = _without_display_curve(fit_input, fit_image(fit_input, start))
    chosen = fits.chosen
    return chosen if isinstance(chosen, Rejected) else Accepted(_grown(fit_input, chosen, fits))


@dataclass(frozen=True, slots=True, eq=False)
class _Fits:
    """Fits of one image: the first, the one to go by, and others in which parts disagree about as little."""

    first: ImageFit | Rejected
    chosen: ImageFit | Rejected
    others: tuple[ImageFit, ...] = ()


def _fits(fit_input: FitInput, start: Transform[Camera, Nail]) -> _Fits:
    """Fits of what the image shows, and the one to go by: without the display's curve, or without objects.

    What is far darker than the fit is an object: a curve bent until it explains one leaves a fit that errs and agrees.
    """
    first = fit_image(fit_input, start)
    beside = fit_beside_objects(fit_input, start, first) if shows_an_object(first) else None
    if beside is not None and is_plain(beside):
        return _Fits(beside, beside)
    fits = _without_display_curve(fit_input, first)
    if not is_refused(fits.chosen):
        return fits
    beside = fit_beside_objects(fit_input, start, first) if beside is None else beside
    return _Fits(beside, beside)


def _without_display_curve(fit_input: FitInput, as_shown: ImageFit | Rejected) -> _Fits:
    """Fits without the display's curve, where parts of the image disagree and that makes them agree better."""
    best = found = as_shown
    fits = []
    for _ in range(DISPLAY_CURVE.most_rounds):
        if isinstance(found, Rejected) or disagreement(found) < DISPLAY_CURVE.least_error_ratio:
            break
        curve = display_curve_of(found.end.solution.linear, fit_input.pixels)
        if found is as_shown and curve.explained_share < DISPLAY_CURVE.least_explained_share:
            break
        fits.append(found)
        fit_input = replace(fit_input, pixels=curve.undone(fit_input.pixels))
        found = fit_image(fit_input, found.fit.camera_from_nail)
        largest = min(DISPLAY_CURVE.remaining_share * disagreement(best), DISPLAY_CURVE.largest_error_ratio)
        if disagreement(found) < largest:
            best = found
    if not isinstance(found, Rejected):
        fits.append(found)
    limit = DISPLAY_CURVE.as_good * disagreement(best)
    return _Fits(as_shown, best, tuple(one for one in fits if one is not best and disagreement(one) < limit))


def _grown(fit_input: FitInput, found: ImageFit, fits: _Fits) -> NailFit:
    """The fit that was found, its errors grown by the display's curve: by what is left of it, and by the choice.

    A curve that turns all parts alike makes none of them disagree, and one that was undone may have been the wrong one:
    where another fit leaves about as little disagreement, the nail may as well be there.
    """
    square = np.radians(_turn_by_curve_deg(fit_input, found, fits.first)) ** 2 * np.eye(2)
    growth = covariance_of_turns(fit_input.nail, square)
    here = found.fit.camera_from_nail
    motions = [here.motion_to(other.fit.camera_from_nail) for other in fits.others]
    if motions:
        farthest = max(motions, key=lambda motion: float(np.linalg.norm(motion[:3])))
        growth = growth + np.outer(farthest, farthest)
    turn_deg = float(np.degrees(np.sqrt(np.linalg.eigvalsh(growth[:3, :3]).max())))
    return replace(found.fit, errors=found.fit.errors.with_more(growth), display_turn_deg=turn_deg)


def _turn_by_curve_deg(fit_input: FitInput, found: ImageFit, first: ImageFit | Rejected) -> float:
    """By how much the curve that is left turns the nail, where the first fit shows one."""
    first = found if isinstance(first, Rejected) else first
    shown = display_curve_of(first.end.solution.linear, fit_input.pixels)
    if shown.explained_share < DISPLAY_CURVE.least_explained_share:
        return 0.0
    left = shown if found is first else display_curve_of(found.end.solution.linear, fit_input.pixels)
    return DISPLAY_CURVE.turn_deg * min(left.change, DISPLAY_CURVE.largest_change)
