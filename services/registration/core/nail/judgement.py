"""Whether a fitted nail may be believed: how much of each hole was seen, and what the model leaves unexplained."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.forward_model import ForwardModel, visible_fraction_without_metal
from services.registration.core.nail.imaging_chain import blurred_image
from services.registration.core.nail.least_squares import LinearSolution, NoiseModel, Problem, Solution
from services.registration.core.nail.noise import MEDIAN_TO_DEVIATION
from services.registration.core.nail.region import FitRegion
from shared.errors import Reason, ReasonCode, Rejected
from shared.figures import figure
from shared.geometry.parts import Hole, NailPart

_OPEN = 0.5
_LEAST_CONTRAST_TO_NOISE = 3.0
_MOST_RADIUS_EXCESS_MM = 0.12
_MOST_STRUCTURE = 2.5
_MOST_INFLATION = 10.0
# One opening alone was measured to be explained by a pose 9 degrees or 2 mm off with margins up to 13.
_LEAST_MIRROR_MARGIN, LEAST_MARGIN_OF_ONE_HOLE = 8.0, 40.0
_MOST_SPOT, _CERTAIN, _LEAST_STEP = 0.3, 8.0, 0.3
_STRUCTURE_BLUR_PX, _SPOT_BLUR_PX = 2.0, 1.0
_ABOUT_HOLE_MM = 1.0
_RIM = (0.03, 0.97)


@dataclass(frozen=True, slots=True)
class LeastOpenings:
    """How much of a hole's disc must be seen: of the hole that shows most, and of each other one.

    One hole tells the tilt; of the others so much must show that their spacing is checked and not only believed.
    """

    of_best: float
    of_others: float


CLEAR_VIEW = LeastOpenings(0.35, 0.12)


@dataclass(frozen=True, slots=True)
class HoleView:
    """How a hole was seen.

    Attributes
    ----------
    opening
        Area through which background is seen, clear of balls and inside the image, as a share of the bore's disc.
    contrast_to_noise
        Brightness of the opening over the metal around it, in standard deviations of a pixel.
    """

    id: str
    opening: float
    contrast_to_noise: float


@dataclass(frozen=True, slots=True)
class ResidualStatistics:
    """What the model does not explain.

    Attributes
    ----------
    rms_grey
        Root mean square of the residual in the image's grey values.
    structure
        Rms of the smoothed residual around rims and edges, over that elsewhere: one when only noise is left.
    noise_inflation
        Variance of a mean over many pixels, over that of independent pixels.
    spot
        Largest smoothed residual in and about a hole, as a share of the step from metal to background, if it is far
        beyond noise: a wrong pose may explain all but a small piece of a hole that shows between two balls.
    """

    rms_grey: float
    structure: float
    noise_inflation: float
    spot: float


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the verdict rests on."""

    nail: NailPart
    holes: tuple[HoleView, ...]
    residual: ResidualStatistics
    hole_radius_excess_mm: float
    nail_radius_excess_mm: float
    mirror_margin: float
    least_openings: LeastOpenings = CLEAR_VIEW


def reasons_against(evidence: Evidence) -> tuple[Reason, ...]:
    """Why the fit must be refused; empty when it may be used. What is no number is a reason too."""
    return (*_unseen_holes(evidence), *_mismatch(evidence), *_ambiguity(evidence))


def nail_outside(nail: NailPart) -> Rejected:
    """Refusal when the strip around the holes is not in the image."""
    names = ", ".join(f"'{h.id}'" for h in nail.holes)
    message = (
        f"the nail's holes ({names}) lie outside the image, or fewer than 200 pixels around them do inside; "
        "centre the holes and take one more image"
    )
    return Rejected((Reason(ReasonCode.HOLE_NOT_VISIBLE, message),))


def hole_views(problem: Problem, solution: Solution) -> tuple[HoleView, ...]:
    """Opening and contrast of each hole of the nail."""
    model = problem.model
    region = model.region
    parameters = solution.parameters
    clear = solution.linear.traced.transmission.ravel()[region.compared] > _OPEN
    noise = float(np.sqrt(np.median(1.0 / problem.weight)))
    contrast = _local_step(model, solution.linear) / noise
    return tuple(_hole_view(problem, parameters, hole, clear, contrast) for hole in model.nail.holes)


def _hole_view(
    problem: Problem,
    parameters: NDArray[np.float64],
    hole: Hole,
    clear: NDArray[np.bool_],
    contrast: NDArray[np.float64],
) -> HoleView:
    model = problem.model
    region = model.region
    radius = 0.5 * hole.diameter_mm
    centre_x, centre_y = hole.axis.point_mm[:2]
    near = np.hypot(region.along_mm - centre_x, region.across_mm - centre_y) < 1.5 * radius
    inside_nail = np.abs(region.across_mm) < 0.8 * model.nail.radius_mm
    seen = clear & near & inside_nail
    depth = float(model.pose(parameters).translation_mm[2])
    pixel_mm = depth / model.camera.focal_length_px * region.scale.reduction
    opening = float(np.count_nonzero(seen)) * pixel_mm**2 / (np.pi * radius**2)
    to_noise = float(np.median(contrast[seen])) if np.any(seen) else 0.0
    return HoleView(hole.id, min(opening, 1.0), to_noise)


def residual_statistics(problem: Problem, solution: Solution, noise: NoiseModel) -> ResidualStatistics:
    """Size and structure of the residual."""
    region, residual = problem.model.region, solution.linear.residual
    standardised = np.zeros(region.shape)
    standardised.ravel()[region.compared] = np.clip(residual * np.sqrt(problem.weight), -6.0, 6.0)
    smooth = blurred_image(standardised, _STRUCTURE_BLUR_PX).ravel()[region.compared]
    visible = solution.linear.visible
    rim = (visible > _RIM[0]) & (visible < _RIM[1])
    elsewhere = ~rim
    rms = float(np.sqrt(np.mean(residual**2))) * region.grey_scale
    reference = float(np.sqrt(np.mean(smooth[elsewhere] ** 2))) if np.any(elsewhere) else 1.0
    at_rims = float(np.sqrt(np.mean(smooth[rim] ** 2))) if np.any(rim) else 0.0
    inflation = float(noise.inflation.mean())
    return ResidualStatistics(rms, at_rims / max(reference, 1e-9), inflation, _spot(problem, solution.linear, noise))


def _spot(problem: Problem, linear: LinearSolution, noise: NoiseModel) -> float:
    region = problem.model.region
    near = np.zeros(len(region.compared), dtype=bool)
    for hole in problem.model.nail.holes:
        x, y = hole.axis.point_mm[:2]
        near |= np.hypot(region.along_mm - x, region.across_mm - y) < 0.5 * hole.diameter_mm + _ABOUT_HOLE_MM
    step = np.abs(_local_step(problem.model, linear))
    deviations = np.abs(_smoothed(region, linear.residual / np.sqrt(noise.variance)))
    certain = deviations > _CERTAIN * MEDIAN_TO_DEVIATION * np.median(deviations)
    share = np.abs(_smoothed(region, linear.residual)) / np.maximum(step, _LEAST_STEP * np.median(step))
    return float(share[near & certain].max(initial=0.0))


def _local_step(model: ForwardModel, linear: LinearSolution) -> NDArray[np.float64]:
    """From the grey value behind metal to the one that no metal hides, under the guide's body, shape (N,)."""
    return visible_fraction_without_metal(model, linear.traced.parameters) * (linear.background - linear.floor)


def _smoothed(region: FitRegion, values: NDArray[np.float64]) -> NDArray[np.float64]:
    image = np.zeros(region.shape)
    image.ravel()[region.compared] = values
    return blurred_image(image, _SPOT_BLUR_PX).ravel()[region.compared]


def _unseen_holes(evidence: Evidence) -> list[Reason]:
    best, least = max(evidence.holes, key=lambda view: view.opening), evidence.least_openings
    return [
        reason
        for view in evidence.holes
        for reason in _unseen(view, least.of_best if view is best else least.of_others)
    ]


def _unseen(view: HoleView, least_opening: float) -> Iterator[Reason]:
    if not view.opening >= least_opening:
        message = (
            f"hole '{view.id}' shows {figure(100 * view.opening, 100 * least_opening, 0)} % of its disc (limit "
            f"{100 * least_opening:.0f} %); turn the C-arm towards the hole's axis, or move what covers it, and take "
            "one more image"
        )
        yield Reason(ReasonCode.HOLE_NOT_VISIBLE, message)
    elif not view.contrast_to_noise >= _LEAST_CONTRAST_TO_NOISE:
        message = (
            f"hole '{view.id}' is {figure(view.contrast_to_noise, _LEAST_CONTRAST_TO_NOISE, 1)} standard deviations of "
            f"the noise brighter than the metal around it (limit {_LEAST_CONTRAST_TO_NOISE:.1f}); raise the dose and "
            "take one more image"
        )
        yield Reason(ReasonCode.HOLE_NOT_VISIBLE, message)


def _mismatch(evidence: Evidence) -> list[Reason]:
    reasons = []
    most_mm = 2 * _MOST_RADIUS_EXCESS_MM
    measured = (("holes measure", evidence.hole_radius_excess_mm), ("nail measures", evidence.nail_radius_excess_mm))
    for what, excess in measured:
        if not abs(excess) <= _MOST_RADIUS_EXCESS_MM:
            message = (
                f"the {what} {figure(2 * excess, most_mm, 2, '+')} mm in diameter against the nail file "
                f"(limit {most_mm:.2f} mm); check that the file is that of the implanted nail"
            )
            reasons.append(Reason(ReasonCode.NAIL_MODEL_MISMATCH, message))
    if not evidence.residual.structure <= _MOST_STRUCTURE:
        message = (
            f"the residual along the nail's edges is {figure(evidence.residual.structure, _MOST_STRUCTURE, 1)} times "
            f"that elsewhere (limit {_MOST_STRUCTURE:.1f}); check the nail file, remove what lies over the holes, and "
            "take one more image"
        )
        reasons.append(Reason(ReasonCode.NAIL_MODEL_MISMATCH, message))
    if not evidence.residual.spot <= _MOST_SPOT:
        spot, most = 100.0 * evidence.residual.spot, 100.0 * _MOST_SPOT
        message = (
            f"a spot at a hole differs from the best fit by {figure(spot, most, 0)} % of the step from metal to "
            f"background (limit {most:.0f} %): something lies over it, or balls hide so much of its rim that the pose "
            "is wrong; remove what lies there, or turn the C-arm by 5°, and take one more image"
        )
        reasons.append(Reason(ReasonCode.NAIL_MODEL_MISMATCH, message))
    if not evidence.residual.noise_inflation <= _MOST_INFLATION:
        message = (
            "after removal of the noise's own correlation the residuals around the nail still go together over "
            f"{figure(evidence.residual.noise_inflation, _MOST_INFLATION, 1)} pixels (limit {_MOST_INFLATION:.0f}): "
            "something that the nail file does not describe lies there; check the file, or take one more image without "
            "it"
        )
        reasons.append(Reason(ReasonCode.NAIL_MODEL_MISMATCH, message))
    return reasons


def _ambiguity(evidence: Evidence) -> list[Reason]:
    if evidence.mirror_margin >= _LEAST_MIRROR_MARGIN:
        return []
    message = (
        "the reflected tilt explains the image nearly as well: logarithm of the likelihood ratio "
        f"{figure(evidence.mirror_margin, _LEAST_MIRROR_MARGIN, 1)} (limit {_LEAST_MIRROR_MARGIN:.0f}); turn the C-arm "
        "by 5° and take one more image"
    )
    return [Reason(ReasonCode.MIRROR_AMBIGUOUS, message)]
