"""The fit of one image as it is shown: stages, the nail's bend, and the evidence for its acceptance."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import NAIL_OUTSIDE
from services.registration.core.acceptance.image import FitEvidence, fit_reasons
from services.registration.core.estimation.pose_estimate import PoseErrors
from services.registration.core.nail.bent_nail import apart_rad, bent_optimum
from services.registration.core.nail.between_holes import spread_of_holes_mm
from services.registration.core.nail.covariance import (
    curvature_covariance,
    errors_of_straight,
    pose_errors,
    with_chamfers_as_seen,
)
from services.registration.core.nail.evidence import (
    agreement_of_parts,
    hole_views,
    log_attenuation,
    residual_statistics,
    rim_shares,
)
from services.registration.core.nail.forward_model import ForwardModel, model_at
from services.registration.core.nail.hole_content import loosened, with_evident_looseness
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
from services.registration.core.tuning import BENT_NAIL, DISPLAY_CURVE, FINAL_STAGE, NAIL_PRIORS
from shared.errors import Rejected
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
    evidence: FitEvidence
    curvature_per_m: tuple[float, float]  # of the centre line towards the nail's y and z; zero where none was found
    display_turn_deg: float = 0.0  # standard error of its rotation by a display's curve that changes with the place
    other_bend_deg: float = 0.0  # how far the holes' axes are of a nail bent otherwise that explains the image as well


@dataclass(frozen=True, slots=True, eq=False)
class FitEnd:
    """Where a fit ended."""

    problem: Problem
    solution: Solution
    noise: NoiseModel
    margin: float  # see `FitEvidence.mirror_margin`
    # see `FitEvidence`
    bent_margin: float = np.inf
    straight_margin: float = np.inf
    near: Solution | None = None  # see `BentOptimum`

    @staticmethod
    def of(problem: Problem, solution: Solution, margin: float) -> "FitEnd":
        """The end of a fit, with derivatives and noise from there."""
        solution = with_derivatives(problem, solution)
        return FitEnd(problem, solution, estimate_noise(problem, solution.linear), margin)


@dataclass(frozen=True, slots=True, eq=False)
class ImageFit:
    """A fit, and how it ended."""

    fit: NailFit
    end: FitEnd


def is_refused(found: ImageFit | Rejected) -> bool:
    """Whether a fit is not acceptable."""
    return isinstance(found, Rejected) or bool(fit_reasons(found.fit.evidence))


def is_plain(found: ImageFit | Rejected) -> bool:
    """Whether a fit is acceptable, and its parts agree as those of plain images do."""
    return not is_refused(found) and disagreement(found) < DISPLAY_CURVE.least_error_ratio


def disagreement(found: ImageFit | Rejected) -> float:
    """By how much parts of the image disagree over what noise explains; infinite without a fit."""
    return float("inf") if isinstance(found, Rejected) else found.fit.evidence.error_ratio


def fit_image(fit_input: FitInput, start: Transform[Camera, Nail]) -> ImageFit | Rejected:
    """The straight nail's fit, unless the pixels show a curvature that no straight nail has.

    Wrong brightness between the rims looks like a bend as well, and so do the remains of an object that was left out:
    where parts of the image disagree, and beside objects, the curvature that was found is what the straight nail's is
    uncertain by. So is it where a nail that is hardly bent explains the image nearly as well. Beside objects none is
    looked for where the straight nail is refused without it.
    """
    optimum = find_global_optimum(fit_input, start)
    model = None if optimum is None else model_at(fit_input, optimum.camera_from_nail, FINAL_STAGE, 1)
    if optimum is None or model is None:
        return Rejected((NAIL_OUTSIDE.reason(),))
    straight, beside = _refined(model, optimum), fit_input.objects_left_out
    freed, there = with_curvature(straight.problem, straight.solution)
    curvature_sd = NAIL_PRIORS.straightness_sd_per_m
    found = _held_straight(straight, there, curvature_sd, objects_left_out=beside)
    if beside and is_refused(found):
        return found  # no bend is believed here, and none makes up for why the straight nail is refused
    ends = _bent(straight, freed, there, optimum.bent_margin)
    if ends is None:
        return found
    end, straight = ends
    bent = _with_evidence(end, pose_errors(end.problem, end.solution, end.noise), objects_left_out=beside)
    curvature = np.array(bent.fit.curvature_per_m)
    evident = is_bent(curvature, bent.fit.errors.bend_covariance)
    doubtful = evident and end.near is not None and not _is_bent_as(end.near, bent)
    if bent.fit.evidence.error_ratio > BENT_NAIL.largest_error_ratio or (beside and evident) or doubtful:
        curvature_sd = float(np.hypot(curvature_sd, np.linalg.norm(curvature)))
    elif evident:
        return _beside_near(bent)
    held = _held_straight(straight, there, curvature_sd, objects_left_out=beside)
    return replace(held, fit=replace(held.fit, other_bend_deg=_near_deg(end))) if doubtful else held


def _is_bent_as(near: Solution, bent: ImageFit) -> bool:
    return is_bent(np.array(curvature_of(near.parameters)), bent.fit.errors.bend_covariance)


def _near_deg(end: FitEnd) -> float:
    """How far the axes of a hole are apart in a bent fit and in the optimum beside it."""
    return 0.0 if end.near is None else float(np.degrees(apart_rad(end.problem, end.near, end.solution)))


def _beside_near(bent: ImageFit) -> ImageFit:
    """A bent nail's fit, uncertain by how far the optimum beside it is."""
    end, fit = bent.end, bent.fit
    if end.near is None:
        return bent
    motion = fit.camera_from_nail.motion_to(end.problem.model.pose(end.near.parameters))
    curvature = np.array(curvature_of(end.near.parameters)) - np.array(fit.curvature_per_m)
    errors = fit.errors.with_alternative(motion, curvature)
    return replace(bent, fit=replace(fit, errors=errors, other_bend_deg=_near_deg(end)))


def _held_straight(end: FitEnd, freed: Solution, curvature_sd: float, *, objects_left_out: bool) -> ImageFit:
    """The straight nail's fit, uncertain by a curvature that the nail may have; `freed` has its derivatives."""
    errors = errors_of_straight(end.problem, end.solution, end.noise, freed, curvature_sd)
    return _with_evidence(end, errors, objects_left_out=objects_left_out)


def _bent(straight: FitEnd, freed: Problem, there: Solution, bent_margin: float) -> tuple[FitEnd, FitEnd] | None:
    """The end of the fit with the curvature free, and the straight one with its margin over bent nails.

    None where noise explains the curvature that the straight fit leaves, and the reflected pose of a bent nail is far
    from explaining the image.

    Parameters
    ----------
    freed, there
        The straight nail's problem with the curvature free, and its end with derivatives by it.
    bent_margin
        See `GlobalOptimum`.
    """
    step = np.asarray(np.linalg.solve(there.equations.matrix, there.equations.gradient))[-len(CURVATURE) :]
    evident = is_bent(step, curvature_covariance(freed, there, straight.noise))
    if not evident and bent_margin > BENT_NAIL.doubtful_margin:
        return None
    # about the holes of a bent nail that is held straight the background is loose because of that
    begun = minimise_from(freed, there.linear, BENT_NAIL.first_steps, FINAL_STAGE.tolerance)
    freed, begun_there = with_evident_looseness(freed, begun.linear)
    found = bent_optimum(freed, begun_there)
    if found is None:
        return None
    linear, margin = found.solution.linear, found.margin
    problem = reweighted(freed, linear, estimate_noise(freed, linear))
    solution = minimise_from(problem, linear, FINAL_STAGE.last_steps, FINAL_STAGE.tolerance)
    end = replace(FitEnd.of(problem, solution, straight.margin if margin is None else margin), near=found.near)
    if found.straight_margin is not None:
        straight = replace(straight, bent_margin=found.straight_margin)
        if found.straight_margin < 0.0:
            end = replace(end, straight_margin=-found.straight_margin)
    return end, straight


def is_bent(curvature_per_m: NDArray[np.float64], covariance: NDArray[np.float64]) -> bool:
    """Whether a curvature, shape (2,), of a covariance is beyond what makers leave in straight nails."""
    expected = covariance + NAIL_PRIORS.straightness_sd_per_m**2 * np.eye(len(CURVATURE))
    return float(curvature_per_m @ np.linalg.solve(expected, curvature_per_m)) > BENT_NAIL.chi_square


def _with_evidence(end: FitEnd, errors: PoseErrors, *, objects_left_out: bool) -> ImageFit:
    """The fit that ended so, its errors grown by what the model does not explain."""
    problem, solution, noise = end.problem, end.solution, end.noise
    model, parameters = problem.model, solution.parameters
    parts = agreement_of_parts(problem, solution, noise)
    evidence = FitEvidence(
        holes=hole_views(problem, solution),
        residual=residual_statistics(problem, solution, noise),
        hole_radius_excess_mm=float(parameters[Parameter.HOLE_RADIUS_EXCESS_MM]),
        nail_radius_excess_mm=float(parameters[Parameter.NAIL_RADIUS_EXCESS_MM]),
        log_attenuation=log_attenuation(problem, solution),
        mirror_margin=end.margin / parts.pull_ratio,
        bent_margin=end.bent_margin / parts.pull_ratio,
        straight_margin=end.straight_margin / parts.pull_ratio,
        error_ratio=parts.error_ratio,
        rim_shares=rim_shares(model.region, model.nail),
        objects_left_out=objects_left_out,
        residual_tails=parts.tails,
        second_bore_deg=parts.second_bore_deg,
        channel_deg=parts.channel_deg,
        hole_spread_mm=max(spread_of_holes_mm(problem, solution, noise), parts.spread_of_holes_mm(model.nail)),
    )
    fit = NailFit(
        model.pose(parameters),
        parts.widened(with_chamfers_as_seen(errors), model.nail),
        evidence,
        curvature_of(parameters),
    )
    return ImageFit(fit, end)


def _refined(model: ForwardModel, optimum: GlobalOptimum) -> FitEnd:
    """Full resolution: estimate the noise where the coarser stage ended, whiten, fit, weight, fit."""
    start = optimum.parameters.copy()
    bent = bool(np.any(np.abs(start[DISPLAY_BENDS]) > FINAL_STAGE.usual_display_bend))
    if not bent:
        start[DISPLAY_BENDS] = 0.0
    problem = loosened(problem_for(model, FINAL_STAGE, STRAIGHT_NAIL if bent else STRAIGHT_DISPLAY))
    problem, here = whitened(*with_hidden_filled(problem, linear_solution_at(problem, start)))
    solution = minimise_from(problem, here, FINAL_STAGE.first_steps, FINAL_STAGE.tolerance)
    problem = reweighted(problem, solution.linear, estimate_noise(problem, solution.linear))
    problem, here = with_evident_looseness(problem, solution.linear)
    # The last steps begin with derivatives from here: those of the first may have led along the valley in which radii,
    # curve and tilt nearly compensate one another, and ended in it.
    solution = minimise_from(problem, here, FINAL_STAGE.last_steps, FINAL_STAGE.tolerance)
    return FitEnd.of(*_with_display_bent_where_evident(problem, solution), optimum.margin)


def _with_display_bent_where_evident(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """Free bulge and S of the display where the image asks for them: plain images are fitted without."""
    freed = replace(problem, free=STRAIGHT_NAIL)
    if np.all(problem.free[DISPLAY_BENDS]) or predicted_decrease(freed, solution.linear) < FINAL_STAGE.evident_decrease:
        return problem, solution
    return freed, minimise_from(freed, solution.linear, FINAL_STAGE.last_steps, FINAL_STAGE.tolerance)
