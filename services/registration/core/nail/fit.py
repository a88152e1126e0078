"""Fit the nail's pose to the pixels by maximum likelihood, with its covariance and the evidence for its acceptance.

`docs/nail-likelihood.md` has the model, the alternatives and their measured gains.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import NAIL_OUTSIDE
from services.registration.core.acceptance.image import FitEvidence, HoleView, ResidualStatistics, fit_reasons
from services.registration.core.estimation.pose_estimate import (
    PoseErrors,
)
from services.registration.core.nail.agreement import Agreement
from services.registration.core.nail.bend_search import BentOptimum, bent_optimum
from services.registration.core.nail.covariance import curvature_covariance, errors_of_straight, pose_errors
from services.registration.core.nail.evidence import agreement_of_parts, hole_views, residual_statistics
from services.registration.core.nail.foreign import RimView, foreign_pixels, rim_views
from services.registration.core.nail.forward_model import ForwardModel, model_at
from services.registration.core.nail.least_squares import (
    Problem,
    Solution,
    estimate_noise,
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
from services.registration.core.nail.noise import NoiseModel
from services.registration.core.nail.parameters import (
    CURVATURE,
    DISPLAY_BENDS,
    STRAIGHT_DISPLAY,
    STRAIGHT_NAIL,
    Parameter,
    curvature_of,
)
from services.registration.core.nail.region import FitInput
from services.registration.core.nail.tilt_ambiguity import GlobalOptimum, find_global_optimum
from services.registration.core.tuning import (
    BENT_NAIL,
    FINAL_STAGE,
    FOREIGN_OBJECTS,
    NAIL_PRIORS,
)
from shared.errors import Accepted, Rejected
from shared.geometry.frames import Camera, Nail
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
    stay = straight, errors_of_straight(straight.problem, straight.solution, straight.noise, there)
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
