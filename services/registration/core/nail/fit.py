"""Fit the nail's pose to the pixels by maximum likelihood, with its covariance and the evidence for its acceptance.

`docs/nail-likelihood.md` has the model, the alternatives and their measured gains.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from services.registration.core.acceptance.criteria import NAIL_OUTSIDE
from services.registration.core.acceptance.image import FitEvidence, HoleView, ResidualStatistics, fit_reasons
from services.registration.core.estimation.pose_estimate import (
    POSE_SIZE,
    PoseErrors,
    model_loadings,
    model_loadings_of_shape,
    ray_to,
)
from services.registration.core.nail.agreement import Agreement, PixelScores, agreement
from services.registration.core.nail.bend_search import BentOptimum, bent_optimum
from services.registration.core.nail.foreign import RimView, foreign_pixels, rim_views
from services.registration.core.nail.forward_model import ForwardModel, model_at, visible_fraction_without_metal
from services.registration.core.nail.imaging_chain import blurred_image
from services.registration.core.nail.least_squares import (
    Problem,
    Solution,
    estimate_noise,
    linear_response,
    linear_solution_at,
    minimise_from,
    predicted_decrease,
    problem_for,
    reweighted,
    whitened,
    with_curvature,
    with_derivatives,
    with_hidden_filled,
)
from services.registration.core.nail.noise import MEDIAN_TO_DEVIATION, NoiseModel, covariance_of_sums
from services.registration.core.nail.parameters import (
    CURVATURE,
    DISPLAY_BENDS,
    SHAPE_PARAMETERS,
    STRAIGHT_DISPLAY,
    STRAIGHT_NAIL,
    Parameter,
    curvature_of,
    motion_by_parameters,
    prior_mean,
    prior_precision,
)
from services.registration.core.nail.region import FitInput, FitRegion
from services.registration.core.nail.tilt_ambiguity import GlobalOptimum, find_global_optimum
from services.registration.core.tuning import (
    BENT_NAIL,
    FINAL_STAGE,
    FOREIGN_OBJECTS,
    MODEL_ERRORS,
    NAIL_EVIDENCE,
    NAIL_PRIORS,
)
from shared.errors import Accepted, Rejected
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import Hole
from shared.geometry.transform import Transform


@dataclass(frozen=True, slots=True, eq=False)
class NailFit:
    """Pose of the nail with its errors, and the evidence for its acceptance."""

    camera_from_nail: Transform[Camera, Nail]  # the pose
    # Of the small motion `m` with true pose = `camera_from_nail @ m`: rotation vector (rad), then translation (mm),
    # both in the nail's frame at its origin. Correlated noise, all nuisances and the model's own errors are included;
    # calibration's and guide's errors are not.
    errors: PoseErrors
    # Logarithm of the likelihood ratio between this pose and the other optimum (at least 1.5° away, in practice the
    # reflected tilt), or, when there is no other, the best pose with pitch or roll 3° away. The noise's correlation is
    # divided out, so that the ratio is that of as many independent samples. For a competing pose that was abandoned it
    # is a lower bound.
    mirror_margin: float
    # Fitted radii less those of the part
    hole_radius_excess_mm: float
    nail_radius_excess_mm: float
    blur_px: float  # standard deviation of the blur that was fitted
    residual: ResidualStatistics  # statistics of what the model does not explain
    holes: tuple[HoleView, ...]  # how much of each hole was seen
    rims: tuple[RimView, ...]  # how much of each rim takes part
    agreement: Agreement  # of the image's parts about the pose
    curvature_per_m: tuple[float, float]  # of the centre line towards the nail's y and z; zero where none was found

    @property
    def evidence(self) -> FitEvidence:
        """What its acceptance depends on."""
        return FitEvidence(
            self.holes,
            self.residual,
            self.hole_radius_excess_mm,
            self.nail_radius_excess_mm,
            self.mirror_margin,
            self.agreement.error_ratio,
            tuple(rim.share for rim in self.rims),
        )


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
    found = _fitted(fit_input, start)
    for _ in range(FOREIGN_OBJECTS.most_rounds):
        if isinstance(found, Rejected) or not fit_reasons(found.fit.evidence):
            break
        without = _without_foreign_objects(fit_input, found)
        if without is None:
            break
        fit_input, found = without, _fitted(without, start)
    if isinstance(found, Rejected):
        return found
    reasons = fit_reasons(found.fit.evidence)
    return Rejected(reasons) if reasons else Accepted(found.fit)


def measure_nail(fit_input: FitInput, start: Transform[Camera, Nail]) -> Accepted[NailFit] | Rejected:
    """The same without acceptance criteria; rejected only when the holes are not in the image."""
    found = _fitted(fit_input, start)
    return found if isinstance(found, Rejected) else Accepted(found.fit)


@dataclass(frozen=True, slots=True, eq=False)
class _Fitted:
    """A fit with the problem that it solved."""

    fit: NailFit
    problem: Problem
    solution: Solution
    noise: NoiseModel


def _fitted(fit_input: FitInput, start: Transform[Camera, Nail]) -> _Fitted | Rejected:
    optimum = find_global_optimum(fit_input, start)
    model = None if optimum is None else model_at(fit_input, optimum.camera_from_nail, FINAL_STAGE, 1)
    if optimum is None or model is None:
        return Rejected((NAIL_OUTSIDE.reason(),))
    end, errors = _bent_or_straight(_refined(model, optimum))
    problem, solution, noise = end.problem, end.solution, end.noise
    parts, camera_from_nail = agreement_of_parts(problem, solution, noise), model.pose(solution.parameters)
    fit = NailFit(
        camera_from_nail=camera_from_nail,
        errors=parts.widened(errors, camera_from_nail),
        mirror_margin=end.margin / parts.pull_ratio,
        hole_radius_excess_mm=float(solution.parameters[Parameter.HOLE_RADIUS_EXCESS_MM]),
        nail_radius_excess_mm=float(solution.parameters[Parameter.NAIL_RADIUS_EXCESS_MM]),
        blur_px=model.region.sampling.blur_px(solution.parameters),
        residual=residual_statistics(problem, solution, noise),
        holes=hole_views(problem, solution),
        rims=rim_views(model.region, model.nail),
        agreement=parts,
        curvature_per_m=curvature_of(solution.parameters),
    )
    return _Fitted(fit, problem, solution, noise)


def _without_foreign_objects(fit_input: FitInput, found: _Fitted) -> FitInput | None:
    """The same input with what is darker than the fit left out; None where there is nothing more."""
    region, residual = found.problem.model.region, found.solution.linear.residual
    foreign = foreign_pixels(region, residual, found.noise.variance, fit_input.pixels.shape)
    hidden = fit_input.occluders.hidden
    if not np.any(foreign if hidden is None else foreign & ~hidden):
        return None
    together = foreign if hidden is None else foreign | hidden
    return replace(fit_input, occluders=replace(fit_input.occluders, hidden=together))


@dataclass(frozen=True, slots=True, eq=False)
class _End:
    """Where a fit ended."""

    problem: Problem
    solution: Solution
    noise: NoiseModel
    margin: float


def _bent_or_straight(straight: _End) -> tuple[_End, PoseErrors]:
    """The end of the straight nail's fit, unless the pixels show a curvature that no straight nail has."""
    freed, there = with_curvature(straight.problem, straight.solution)
    stay = straight, errors_of_straight(straight, there)
    step = np.asarray(np.linalg.solve(there.equations.matrix, there.equations.gradient))[-len(CURVATURE) :]
    if not is_bent(step, curvature_covariance(freed, there, straight.noise)):
        return stay
    found = bent_optimum(freed, straight.solution)
    if found is None:
        return stay
    bent = _finished(freed, found, straight.margin)
    errors = pose_errors(bent.problem, bent.solution, bent.noise)
    parameters = bent.solution.parameters
    pose = bent.problem.model.pose(parameters)
    widened = agreement_of_parts(bent.problem, bent.solution, bent.noise).widened(errors, pose)
    return (bent, errors) if is_bent(np.array(curvature_of(parameters)), widened.bend_covariance) else stay


def is_bent(curvature_per_m: NDArray[np.float64], covariance: NDArray[np.float64]) -> bool:
    """Whether a curvature, shape (2,), of a covariance is beyond what makers leave in straight nails."""
    expected = covariance + NAIL_PRIORS.straightness_sd_per_m**2 * np.eye(len(CURVATURE))
    return float(curvature_per_m @ np.linalg.solve(expected, curvature_per_m)) > BENT_NAIL.chi_square


def _finished(freed: Problem, found: BentOptimum, margin: float) -> _End:
    """Weigh the pixels by what the bent nail leaves of them, and fit once more."""
    linear = found.solution.linear
    problem = reweighted(freed, linear, estimate_noise(freed, linear))
    solution = minimise_from(problem, linear, FINAL_STAGE.last_steps, FINAL_STAGE.tolerance)
    solution = with_derivatives(problem, solution)
    noise = estimate_noise(problem, solution.linear)
    return _End(problem, solution, noise, margin if found.margin is None else found.margin)


def _refined(model: ForwardModel, optimum: GlobalOptimum) -> _End:
    """Full resolution: estimate the noise where the coarser stage ended, whiten, fit, weight, fit."""
    start = optimum.parameters.copy()
    bent = bool(np.any(np.abs(start[DISPLAY_BENDS]) > FINAL_STAGE.usual_display_bend))
    if not bent:
        start[DISPLAY_BENDS] = 0.0
    problem = problem_for(model, FINAL_STAGE, STRAIGHT_NAIL if bent else STRAIGHT_DISPLAY)
    problem, here = whitened(*with_hidden_filled(problem, linear_solution_at(problem, start)))
    solution = minimise_from(problem, here, FINAL_STAGE.first_steps, FINAL_STAGE.tolerance)
    problem = reweighted(problem, solution.linear, estimate_noise(problem, solution.linear))
    # The last steps begin with derivatives from here: those of the first may have led along the valley in which radii,
    # curve and tilt nearly compensate one another, and ended in it.
    solution = minimise_from(problem, solution.linear, FINAL_STAGE.last_steps, FINAL_STAGE.tolerance)
    problem, solution = _with_display_bent_where_evident(problem, solution)
    solution = with_derivatives(problem, solution)
    return _End(problem, solution, estimate_noise(problem, solution.linear), optimum.margin)


def _with_display_bent_where_evident(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """Free bulge and S of the display where the image asks for them: plain images are fitted without."""
    freed = replace(problem, free=STRAIGHT_NAIL)
    if np.all(problem.free[DISPLAY_BENDS]) or predicted_decrease(freed, solution.linear) < FINAL_STAGE.evident_decrease:
        return problem, solution
    return freed, minimise_from(freed, solution.linear, FINAL_STAGE.last_steps, FINAL_STAGE.tolerance)


# Covariance


def pose_covariance(problem: Problem, solution: Solution, noise: NoiseModel) -> NDArray[np.float64]:
    """Covariance of a small motion of the nail in its own frame, shape (6, 6): rotation vector (rad), translation (mm).

    The true pose is `camera_from_nail @ motion` with `motion` this small motion. The fit's weights count slow
    noise as if it affected sharp rims too, so the noise's part follows from its correlation instead (the sandwich
    formula); what priors and background leave open is added.
    """
    return _covariance_by(problem, solution, noise, _motion_gain(problem, solution), prior_precision()[problem.free])


def pose_errors(problem: Problem, solution: Solution, noise: NoiseModel) -> PoseErrors:
    """The same for pose and those of `SHAPE_PARAMETERS` that were free, with the model's own errors."""
    shape = [parameter for parameter in SHAPE_PARAMETERS if problem.free[parameter]]
    precision = prior_precision()[problem.free]
    rows = [int(np.count_nonzero(problem.free[:parameter])) for parameter in shape]
    per_deviation = np.sqrt(precision[rows])
    of_shape = per_deviation[:, None] * np.linalg.inv(solution.equations.matrix)[rows]
    gain = np.vstack([_motion_gain(problem, solution), of_shape])
    precision[rows] = 0.0
    deviations = (solution.parameters - prior_mean())[shape] * per_deviation
    by_others = _covariance_by(problem, solution, noise, gain, precision)
    camera_from_nail = problem.model.pose(solution.parameters)
    of_shapes = model_loadings_of_shape(NAIL_PRIORS.bent_sd_per_m)[: len(shape), : len(shape)]
    by_model = block_diag(model_loadings(problem.model.nail, camera_from_nail), of_shapes)
    pull = gain[:, rows] * per_deviation
    bend_sd = NAIL_PRIORS.bent_sd_per_m if problem.free[CURVATURE].all() else 0.0
    return PoseErrors(deviations, by_others, pull, by_model, ray_to(camera_from_nail), bend_sd)


def errors_of_straight(end: _End, freed: Solution) -> PoseErrors:
    """Errors of a straight nail's fit: a curvature that makers leave in nails, and the fit holds at zero, is added."""
    errors = pose_errors(end.problem, end.solution, end.noise)
    count, of_shape = len(end.solution.equations.gradient), len(errors.shape_deviations)
    followed = np.linalg.solve(freed.equations.matrix[:count, :count], freed.equations.matrix[:count, count:])
    motion = motion_by_parameters(
        end.solution.parameters[:POSE_SIZE], end.problem.model.camera, end.problem.model.anchors
    )
    rows = [int(np.count_nonzero(end.problem.free[:parameter])) for parameter in SHAPE_PARAMETERS[:of_shape]]
    per_deviation = np.sqrt(prior_precision()[list(SHAPE_PARAMETERS[:of_shape])])
    by_curvature = np.vstack([motion @ followed[:POSE_SIZE], per_deviation[:, None] * followed[rows]])
    return errors.with_held_curvature(NAIL_PRIORS.straightness_sd_per_m, by_curvature)


def curvature_covariance(problem: Problem, solution: Solution, noise: NoiseModel) -> NDArray[np.float64]:
    """Covariance of both curvatures by noise, texture, the other priors and the model's own errors, in 1/m²: (2, 2)."""
    gain = np.asarray(np.linalg.inv(solution.equations.matrix))[-len(CURVATURE) :]
    precision = prior_precision()[problem.free]
    precision[-len(CURVATURE) :] = 0.0
    by_model = MODEL_ERRORS.curvature_per_m**2 * np.eye(len(CURVATURE))
    return _covariance_by(problem, solution, noise, gain, precision) + by_model


def _covariance_by(
    problem: Problem,
    solution: Solution,
    noise: NoiseModel,
    gain: NDArray[np.float64],
    precision: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Covariance, shape (G, G), of `gain` times the gradient, shape (G, P), by noise, texture and priors.

    Parameters
    ----------
    precision
        Of the priors that count, shape (P,).
    """
    linear = linear_response(solution.linear, solution.equations.jacobian)
    by_noise = _by_noise(problem, noise, _after_background(problem, solution, linear, gain))
    field = linear[: problem.field.size]
    by_priors = problem.texture_precision * (field.T @ problem.field.roughness @ field)
    by_priors[np.diag_indices(len(by_priors))] += precision
    return np.asarray(by_noise + gain @ by_priors @ gain.T)


def _motion_gain(problem: Problem, solution: Solution) -> NDArray[np.float64]:
    """The nail's small motion per gradient, shape (6, P)."""
    model = problem.model
    motion = motion_by_parameters(solution.parameters[:POSE_SIZE], model.camera, model.anchors)
    return np.asarray(motion @ np.linalg.inv(solution.equations.matrix)[:POSE_SIZE])


def _after_background(
    problem: Problem, solution: Solution, linear: NDArray[np.float64], gain: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Derivatives of the modelled grey values, background and floor refitted by `linear`, times `gain`.

    Shape (N, G), from a gain of shape (G, P).
    """
    visible, size, followed = solution.linear.visible, problem.field.size, linear @ gain.T
    background = np.stack([problem.field.at_places(np.ascontiguousarray(c)) for c in followed[:size].T], axis=1)
    floor = problem.floor @ followed[size:]
    direct = solution.equations.jacobian @ gain.T
    return np.asarray(direct - visible[:, None] * background - (1.0 - visible)[:, None] * floor)


def _by_noise(problem: Problem, noise: NoiseModel, moved_by: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance by noise alone; `moved_by`, shape (N, G), weights the pixels."""
    region = problem.model.region
    images = np.zeros((moved_by.shape[1], *region.shape), dtype=np.float32)
    deviations = problem.weight * np.sqrt(noise.variance)
    images.reshape(len(images), -1)[:, region.compared] = (moved_by * deviations[:, None]).T
    return covariance_of_sums(images, ((noise.dark, 1.0 - noise.brightness), (noise.bright, noise.brightness)))


# Evidence for acceptance


def agreement_of_parts(problem: Problem, solution: Solution, noise: NoiseModel) -> Agreement:
    """Whether sectors of rims and stretches of edges pull on the pose as the noise predicts."""
    linear = linear_response(solution.linear, solution.equations.jacobian)
    moved_by = _after_background(problem, solution, linear, _motion_gain(problem, solution))
    variance = problem.weight**2 * noise.variance * noise.inflation
    pixels = PixelScores(moved_by, problem.weight * solution.linear.residual, variance)
    model = problem.model
    return agreement(model.region, model.nail, pixels, float(noise.inflation.mean()), solution.parameters)


def hole_views(problem: Problem, solution: Solution) -> tuple[HoleView, ...]:
    """Opening and contrast of each hole of the nail."""
    model = problem.model
    region = model.region
    parameters = solution.parameters
    clear = solution.linear.traced.transmission.ravel()[region.compared] > NAIL_EVIDENCE.open_transmission
    noise = float(np.sqrt(np.median(1.0 / problem.weight)))
    contrast = _local_step(problem, solution) / noise
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
    near = np.hypot(region.along_mm - centre_x, region.across_mm - centre_y) < NAIL_EVIDENCE.near_hole_in_radii * radius
    inside_nail = np.abs(region.across_mm) < NAIL_EVIDENCE.inside_nail_in_radii * model.nail.radius_mm
    seen = clear & near & inside_nail
    depth = float(model.pose(parameters).translation_mm[2])
    pixel_mm = depth / model.camera.focal_length_px * region.sampling.reduction
    opening = float(np.count_nonzero(seen)) * pixel_mm**2 / (np.pi * radius**2)
    to_noise = float(np.median(contrast[seen])) if np.any(seen) else 0.0
    return HoleView(hole.id, min(opening, 1.0), to_noise)


def residual_statistics(problem: Problem, solution: Solution, noise: NoiseModel) -> ResidualStatistics:
    """Size and structure of the residual."""
    region, residual = problem.model.region, solution.linear.residual
    most, visible = NAIL_EVIDENCE.clipped_deviations, solution.linear.visible
    standardised = np.clip(residual * np.sqrt(problem.weight), -most, most)
    smooth = _smoothed(region, standardised, NAIL_EVIDENCE.structure_blur_px)
    rim = (visible > NAIL_EVIDENCE.rim_from) & (visible < NAIL_EVIDENCE.rim_to)
    elsewhere = ~rim
    rms = float(np.sqrt(np.mean(residual**2))) * region.grey_scale
    reference = float(np.sqrt(np.mean(smooth[elsewhere] ** 2))) if np.any(elsewhere) else 1.0
    at_rims = float(np.sqrt(np.mean(smooth[rim] ** 2))) if np.any(rim) else 0.0
    inflation = float(noise.inflation.mean())
    return ResidualStatistics(rms, at_rims / max(reference, 1e-9), inflation, _spot(problem, solution, noise))


def _spot(problem: Problem, solution: Solution, noise: NoiseModel) -> float:
    """Largest smoothed residual at a hole, over the step from metal to background, where it is far beyond noise."""
    region, linear = problem.model.region, solution.linear
    near = np.zeros(len(region.compared), dtype=bool)
    for hole in problem.model.nail.holes:
        x, y = hole.axis.point_mm[:2]
        reach_mm = 0.5 * hole.diameter_mm + NAIL_EVIDENCE.about_hole_mm
        near |= np.hypot(region.along_mm - x, region.across_mm - y) < reach_mm
    step, blur_px = np.abs(_local_step(problem, solution)), NAIL_EVIDENCE.spot_blur_px
    deviations = np.abs(_smoothed(region, linear.residual / np.sqrt(noise.variance), blur_px))
    certain = deviations > NAIL_EVIDENCE.certain_deviations * MEDIAN_TO_DEVIATION * np.median(deviations)
    smallest_step = NAIL_EVIDENCE.least_step * np.median(step)
    share = np.abs(_smoothed(region, linear.residual, blur_px)) / np.maximum(step, smallest_step)
    return float(share[near & certain].max(initial=0.0))


def _local_step(problem: Problem, solution: Solution) -> NDArray[np.float64]:
    """From the grey value behind metal to the one without metal, under the guide's body, shape (N,)."""
    linear = solution.linear
    without_metal = visible_fraction_without_metal(problem.model, solution.parameters)
    return without_metal * (linear.background - linear.floor)


def _smoothed(region: FitRegion, values: NDArray[np.float64], blur_px: float) -> NDArray[np.float64]:
    """Values of the compared pixels, shape (N,), after a Gaussian, with zero around them."""
    image = np.zeros(region.shape)
    image.ravel()[region.compared] = values
    return blurred_image(image, blur_px).ravel()[region.compared]
