"""Covariance of a fitted nail: noise with its correlation, texture, priors, the model's own errors, curvature."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from services.registration.core.estimation.pose_estimate import (
    POSE_SIZE,
    PoseErrors,
    model_loadings,
    model_loadings_of_shape,
    ray_to,
)
from services.registration.core.nail.least_squares import Problem, Solution, linear_response
from services.registration.core.nail.noise import NoiseModel, covariance_of_sums
from services.registration.core.nail.parameters import (
    CURVATURE,
    SHAPE_PARAMETERS,
    Parameter,
    prior_mean,
    prior_precision,
)
from services.registration.core.tuning import MODEL_ERRORS, NAIL_PRIORS

# Of a depth that no pixel shows a fit keeps what rounding leaves; where a rim shows at all it kept 1e-4 and more.
_LEAST_KEPT = 1e-6


def nail_pose_covariance(problem: Problem, solution: Solution, noise: NoiseModel) -> NDArray[np.float64]:
    """Covariance of a small motion of the nail in its own frame, shape (6, 6): rotation vector (rad), translation (mm).

    The true pose is `camera_from_nail @ motion` with `motion` this small motion. The fit's weights count slow
    noise as if it affected sharp rims too, so the noise's part follows from its correlation instead (the sandwich
    formula); what priors and background leave open is added.
    """
    return covariance_by(problem, solution, noise, motion_gain(problem, solution), prior_precision()[problem.free])


def pose_errors(problem: Problem, solution: Solution, noise: NoiseModel) -> PoseErrors:
    """The same for pose and those of `SHAPE_PARAMETERS` that were free, with the model's own errors."""
    shape = [parameter for parameter in SHAPE_PARAMETERS if problem.free[parameter]]
    precision = prior_precision()[problem.free]
    rows = [int(np.count_nonzero(problem.free[:parameter])) for parameter in shape]
    per_deviation = np.sqrt(precision[rows])
    of_shape = per_deviation[:, None] * np.linalg.inv(solution.equations.matrix)[rows]
    gain = np.vstack([motion_gain(problem, solution), of_shape])
    precision[rows] = 0.0
    deviations = (solution.parameters - prior_mean())[shape] * per_deviation
    by_others = covariance_by(problem, solution, noise, gain, precision)
    camera_from_nail = problem.model.pose(solution.parameters)
    of_shapes = model_loadings_of_shape(NAIL_PRIORS.bent_sd_per_m)[: len(shape), : len(shape)]
    by_model = block_diag(model_loadings(problem.model.nail, camera_from_nail), of_shapes)
    pull = gain[:, rows] * per_deviation
    bend_sd = NAIL_PRIORS.bent_sd_per_m if problem.free[CURVATURE].all() else 0.0
    return PoseErrors(deviations, by_others, pull, by_model, ray_to(camera_from_nail), bend_sd)


def errors_of_straight(
    problem: Problem, solution: Solution, noise: NoiseModel, freed: Solution, curvature_sd_per_m: float
) -> PoseErrors:
    """Errors of a straight nail's fit: a curvature that the nail may have, and the fit holds at zero, is added."""
    errors = pose_errors(problem, solution, noise)
    count, of_shape = len(solution.equations.gradient), len(errors.shape_deviations)
    followed = np.linalg.solve(freed.equations.matrix[:count, :count], freed.equations.matrix[:count, count:])
    motion = problem.model.motion_by_parameters(solution.parameters)
    rows = [int(np.count_nonzero(problem.free[:parameter])) for parameter in SHAPE_PARAMETERS[:of_shape]]
    per_deviation = np.sqrt(prior_precision()[list(SHAPE_PARAMETERS[:of_shape])])
    by_curvature = np.vstack([motion @ followed[:POSE_SIZE], per_deviation[:, None] * followed[rows]])
    return errors.with_held_curvature(curvature_sd_per_m, by_curvature)


def with_chamfers_as_seen(errors: PoseErrors) -> PoseErrors:
    """Errors with the prior of the chamfers' depth as wide as the image shows that it has to be.

    A fit keeps only a share of how much deeper than usual they are. What it keeps, over the root of that share, is a
    standard normal variable where the prior holds; by what its square is too large the prior's variance is too small.
    """
    column = SHAPE_PARAMETERS.index(Parameter.CHAMFER_DEVIATIONS)
    deeper = float(errors.shape_deviations[column])
    kept = 1.0 - float(errors.shape_pull[POSE_SIZE + column, column])
    if deeper <= 0.0 or kept <= _LEAST_KEPT:  # no chamfer, or no rim in sight: nothing changes with the depth
        return errors
    chi_square = deeper**2 / kept
    missing_variance = max(chi_square - NAIL_PRIORS.usual_chamfer_chi_square, 0.0) / kept
    by_depth = errors.shape_pull[:POSE_SIZE, column]
    return errors.with_more(missing_variance * np.outer(by_depth, by_depth))


def curvature_covariance(problem: Problem, solution: Solution, noise: NoiseModel) -> NDArray[np.float64]:
    """Covariance of both curvatures by noise, texture, the other priors and the model's own errors, in 1/m²: (2, 2)."""
    gain = np.asarray(np.linalg.inv(solution.equations.matrix))[-len(CURVATURE) :]
    precision = prior_precision()[problem.free]
    precision[-len(CURVATURE) :] = 0.0
    by_model = MODEL_ERRORS.curvature_per_m**2 * np.eye(len(CURVATURE))
    return covariance_by(problem, solution, noise, gain, precision) + by_model


def covariance_by(
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
    by_noise = _by_noise(problem, noise, after_background(problem, solution, linear, gain))
    field = linear[: problem.field.size]
    by_priors = problem.texture_precision * (field.T @ problem.field.roughness @ field)
    by_priors[np.diag_indices(len(by_priors))] += precision
    return np.asarray(by_noise + gain @ by_priors @ gain.T)


def further_parameters(
    problem: Problem, changed: Solution, noise: NoiseModel, count: int, precision: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The last parameters of `with_changes` after one Gauss-Newton step, shape (K,), and their covariance, (K, K)."""
    inverse = np.asarray(np.linalg.inv(changed.equations.matrix))[-count:]
    priors = np.concatenate([prior_precision()[problem.free], np.full(count, precision)])
    return inverse @ changed.equations.gradient, covariance_by(problem, changed, noise, inverse, priors)


def share_beyond(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Share of the square of what was found, shape (K,), beyond an expected covariance, by the method of moments."""
    count, chi_square = len(found), float(found @ np.linalg.solve(expected, found))
    return max(1.0 - count / max(chi_square, count), 0.0)


def motion_gain(problem: Problem, solution: Solution) -> NDArray[np.float64]:
    """The nail's small motion per gradient, shape (6, P)."""
    motion = problem.model.motion_by_parameters(solution.parameters)
    return np.asarray(motion @ np.linalg.inv(solution.equations.matrix)[:POSE_SIZE])


def after_background(
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
