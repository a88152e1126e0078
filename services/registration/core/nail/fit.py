"""Fit the nail's pose to the pixels by maximum likelihood: capture, refine, weigh, judge.

The record `docs/decisions/0009-nail-likelihood.md` has the model, the alternatives and their figures.
"""

from dataclasses import dataclass

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
from services.registration.core.nail.evidence import hole_views, residual_statistics
from services.registration.core.nail.forward_model import Detail, FitInput, model_at
from services.registration.core.nail.imaging_chain import Scale
from services.registration.core.nail.least_squares import (
    ALL_PARAMETERS,
    NoiseModel,
    Problem,
    Solution,
    estimate_noise,
    linear_response,
    linear_solution_at,
    minimise_from,
    problem_for,
    reweighted,
    whitened,
    with_derivatives,
)
from services.registration.core.nail.noise import covariance_of_sums
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.parameters import (
    SHAPE_PARAMETERS,
    Parameter,
    motion_by_parameters,
    prior_mean,
    prior_precision,
)
from services.registration.core.nail.tilt_ambiguity import GlobalOptimum, find_global_optimum
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform

_FINE = Detail(Scale(1, 0.0), 3.5, 1.5, 0.015)
_FIRST_STEPS, _LAST_STEPS = 5, 4
_TOLERANCE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class NailFit:
    """Pose of the nail, how sure it is, and what else the pixels said.

    Attributes
    ----------
    camera_from_nail
        The pose.
    errors
        Of the small motion `m` with true pose = `camera_from_nail @ m`: rotation vector (rad), then translation (mm),
        both in the nail's frame at its origin. Correlated noise, all nuisances and the model's own errors are included;
        calibration's and guide's errors are not.
    mirror_margin
        Logarithm of the likelihood ratio between this pose and the other optimum (at least 1.5° away, in practice the
        reflected tilt), or, when there is no other, the best pose with pitch or roll 3° away. The noise's correlation
        is divided out, so that the ratio is that of as many independent samples. Of a rival that is clearly worse it
        is what it exceeds.
    hole_radius_excess_mm, nail_radius_excess_mm
        Fitted radii less those of the part.
    blur_px
        Standard deviation of the blur that was fitted.
    residual
        Statistics of what the model does not explain.
    holes
        How much of each hole was seen.
    """

    camera_from_nail: Transform[Camera, Nail]
    errors: PoseErrors
    mirror_margin: float
    hole_radius_excess_mm: float
    nail_radius_excess_mm: float
    blur_px: float
    residual: ResidualStatistics
    holes: tuple[HoleView, ...]

    @property
    def evidence(self) -> FitEvidence:
        """What its acceptance depends on."""
        return FitEvidence(
            self.holes,
            self.residual,
            self.hole_radius_excess_mm,
            self.nail_radius_excess_mm,
            self.mirror_margin,
        )


def fit_nail(
    pixels: NDArray[np.float32],
    calibration: CArmCalibration,
    nail: NailPart,
    start: Transform[Camera, Nail],
    occluders: Occluders,
) -> Accepted[NailFit] | Rejected:
    """Find where the nail is, from a start within about 5° and 3 mm across, and judge what was found.

    Parameters
    ----------
    pixels
        Grey values of the un-mirrored image, darker is denser, shape (rows, columns).
    start
        First guess of the pose; its tilt may be the reflected one.

    Returns
    -------
    Accepted[NailFit] or Rejected
        Refused as `hole_not_visible`, `nail_model_mismatch` or `mirror_ambiguous`.
    """
    measured = measure_nail(pixels, calibration, nail, start, occluders)
    if isinstance(measured, Rejected):
        return measured
    reasons = fit_reasons(measured.value.evidence)
    return Rejected(reasons) if reasons else measured


def measure_nail(
    pixels: NDArray[np.float32],
    calibration: CArmCalibration,
    nail: NailPart,
    start: Transform[Camera, Nail],
    occluders: Occluders,
) -> Accepted[NailFit] | Rejected:
    """The same without a verdict; rejected only when the strip around the holes is not in the image."""
    given = FitInput(pixels, calibration, nail, occluders)
    winner = find_global_optimum(given, start)
    if winner is None:
        return Rejected((NAIL_OUTSIDE.reason(),))
    model = model_at(given, winner.camera_from_nail, _FINE)
    if model is None:
        return Rejected((NAIL_OUTSIDE.reason(),))
    problem, solution, noise = _refined(problem_for(model, _FINE, ALL_PARAMETERS), winner)
    return Accepted(
        NailFit(
            model.pose(solution.parameters),
            pose_errors(problem, solution, noise),
            winner.margin,
            float(solution.parameters[Parameter.HOLE_RADIUS_EXCESS_MM]),
            float(solution.parameters[Parameter.NAIL_RADIUS_EXCESS_MM]),
            float(np.exp(solution.parameters[Parameter.LOG_BLUR_PX])),
            residual_statistics(problem, solution, noise),
            hole_views(problem, solution),
        )
    )


def _refined(problem: Problem, winner: GlobalOptimum) -> tuple[Problem, Solution, NoiseModel]:
    """Full resolution: learn the noise where the coarser stage ended, filter the noise, fit, weigh, fit."""
    here = linear_solution_at(problem, winner.parameters)
    problem, here = whitened(problem, here, estimate_noise(problem, here))
    solution = minimise_from(problem, here, _FIRST_STEPS, _TOLERANCE)
    problem = reweighted(problem, solution.linear, estimate_noise(problem, solution.linear))
    # begun with derivatives from here: those of the first steps may have led along the valley in which radii, curve and
    # tilt nearly make up for one another, and ended in it
    solution = with_derivatives(problem, minimise_from(problem, solution.linear, _LAST_STEPS, _TOLERANCE))
    return problem, solution, estimate_noise(problem, solution.linear)


def pose_covariance(problem: Problem, solution: Solution, noise: NoiseModel) -> NDArray[np.float64]:
    """Covariance of a small motion of the nail in its own frame, shape (6, 6): rotation vector (rad), translation (mm).

    The true pose is `camera_from_nail @ motion` with `motion` this small motion. The fit's weights are a compromise:
    they count slow noise, which hides the tilt, as if it hid sharp rims too. What the noise does to the fit follows
    from its correlation instead (the sandwich formula); to it comes what priors and background leave open.
    """
    return _covariance_by(problem, solution, noise, _motion_gain(problem, solution), prior_precision()[problem.free])


def pose_errors(problem: Problem, solution: Solution, noise: NoiseModel) -> PoseErrors:
    """The same for pose and shape together, and the model's own errors; all of `SHAPE_PARAMETERS` were free."""
    precision = prior_precision()[problem.free]
    places = [int(np.count_nonzero(problem.free[:unknown])) for unknown in SHAPE_PARAMETERS]
    per_deviation = np.sqrt(precision[places])
    of_shape = per_deviation[:, None] * np.linalg.inv(solution.normal_matrix)[places]
    gain = np.vstack([_motion_gain(problem, solution), of_shape])
    precision[places] = 0.0
    deviations = (solution.parameters - prior_mean())[list(SHAPE_PARAMETERS)] * per_deviation
    by_others = _covariance_by(problem, solution, noise, gain, precision)
    camera_from_nail = problem.model.pose(solution.parameters)
    by_model = block_diag(model_loadings(problem.model.nail, camera_from_nail), model_loadings_of_shape())
    return PoseErrors(deviations, by_others, gain[:, places] * per_deviation, by_model, ray_to(camera_from_nail))


def _covariance_by(
    problem: Problem,
    solution: Solution,
    noise: NoiseModel,
    gain: NDArray[np.float64],
    precision: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Covariance of what follows from the gradient by `gain`, shape (G, P), as far as noise and open ends go.

    Parameters
    ----------
    precision
        Of the priors that leave an end open, shape (P,).
    """
    linear = linear_response(problem, solution.linear, solution.moves.of_pixels)
    by_noise = _by_noise(problem, noise, _after_background(problem, solution, linear, gain))
    field = linear[: problem.field.size]
    open_ends = problem.texture_precision * (field.T @ problem.field.roughness @ field)
    open_ends[np.diag_indices(len(open_ends))] += precision
    return np.asarray(by_noise + gain @ open_ends @ gain.T)


def _motion_gain(problem: Problem, solution: Solution) -> NDArray[np.float64]:
    """The nail's small motion per gradient, shape (6, P)."""
    model = problem.model
    motion = motion_by_parameters(solution.parameters[:POSE_SIZE], model.camera, model.anchors)
    return np.asarray(motion @ np.linalg.inv(solution.normal_matrix)[:POSE_SIZE])


def _after_background(
    problem: Problem, solution: Solution, linear: NDArray[np.float64], gain: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Derivatives of the modelled grey values when background and floor follow as `linear` says, times `gain`.

    Shape (N, G), from a gain of shape (G, P).
    """
    visible, size, followed = solution.linear.visible, problem.field.size, linear @ gain.T
    background = np.stack([problem.field.at_places(np.ascontiguousarray(c)) for c in followed[:size].T], axis=1)
    floor = problem.floor @ followed[size:]
    direct = solution.moves.of_pixels @ gain.T
    return np.asarray(direct - visible[:, None] * background - (1.0 - visible)[:, None] * floor)


def _by_noise(problem: Problem, noise: NoiseModel, moved_by: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance by noise alone; `moved_by`, shape (N, G), weighs the pixels."""
    region = problem.model.region
    images = np.zeros((moved_by.shape[1], *region.shape), dtype=np.float32)
    deviations = problem.weight * np.sqrt(noise.variance)
    images.reshape(len(images), -1)[:, region.compared] = (moved_by * deviations[:, None]).T
    return covariance_of_sums(images, ((noise.dark, 1.0 - noise.brightness), (noise.bright, noise.brightness)))
