"""How far the fitted pose may be off, in a form that others can use: a small motion of the nail in its own frame."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from services.registration.core.nail.equations import Problem, followed_by_linear
from services.registration.core.nail.noise import covariance_of_sums
from services.registration.core.nail.pose import POSE_SIZE, motion_by_parameters
from services.registration.core.nail.solver import Solution
from services.registration.core.nail.stages import Noise
from services.registration.core.nail.unknowns import SHAPE_UNKNOWNS, prior_mean, prior_precision
from services.registration.core.pose_errors import MODEL_SD_OF_SHAPE, PoseErrors, model_loadings


def pose_covariance(problem: Problem, solution: Solution, noise: Noise) -> NDArray[np.float64]:
    """Covariance of a small motion of the nail in its own frame, shape (6, 6): rotation vector (rad), translation (mm).

    The true pose is `camera_from_nail @ motion` with `motion` this small motion. The fit's weights are a compromise:
    they count slow noise, which hides the tilt, as if it hid sharp rims too. What the noise does to the fit follows
    from its correlation instead (the sandwich formula); to it comes what priors and background leave open.
    """
    return _spread(problem, solution, noise, _motion_gain(problem, solution), prior_precision()[problem.free])


def pose_errors(problem: Problem, solution: Solution, noise: Noise) -> PoseErrors:
    """The same for pose and shape together, and the model's own errors; all of `SHAPE_UNKNOWNS` must have been free."""
    precision = prior_precision()[problem.free]
    places = [int(np.count_nonzero(problem.free[:unknown])) for unknown in SHAPE_UNKNOWNS]
    per_deviation = np.sqrt(precision[places])
    of_shape = per_deviation[:, None] * np.linalg.inv(solution.normal_matrix)[places]
    gain = np.vstack([_motion_gain(problem, solution), of_shape])
    precision[places] = 0.0
    deviations = (solution.parameters - prior_mean())[list(SHAPE_UNKNOWNS)] * per_deviation
    by_others = _spread(problem, solution, noise, gain, precision)
    by_model = model_loadings(problem.scene.nail, problem.scene.pose(solution.parameters))
    by_model = block_diag(by_model, np.diag(MODEL_SD_OF_SHAPE))
    return PoseErrors(deviations, by_others, gain[:, places] * per_deviation, by_model)


def _spread(
    problem: Problem,
    solution: Solution,
    noise: Noise,
    gain: NDArray[np.float64],
    precision: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Covariance of what follows from the gradient by `gain`, shape (G, P), as far as noise and open ends go.

    Parameters
    ----------
    precision
        Of the priors that leave an end open, shape (P,).
    """
    linear = followed_by_linear(problem, solution.linear, solution.moves.of_pixels)
    by_noise = _by_noise(problem, noise, _after_background(problem, solution, linear, gain))
    field = linear[: problem.field.size]
    open_ends = problem.texture_precision * (field.T @ problem.field.roughness @ field)
    open_ends[np.diag_indices(len(open_ends))] += precision
    return np.asarray(by_noise + gain @ open_ends @ gain.T)


def _motion_gain(problem: Problem, solution: Solution) -> NDArray[np.float64]:
    """The nail's small motion per gradient, shape (6, P)."""
    scene = problem.scene
    motion = motion_by_parameters(solution.parameters[:POSE_SIZE], scene.camera, scene.anchors)
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


def _by_noise(problem: Problem, noise: Noise, moved_by: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance by noise alone; `moved_by`, shape (N, G), weighs the pixels."""
    window = problem.scene.window
    images = np.zeros((moved_by.shape[1], *window.shape), dtype=np.float32)
    deviations = problem.weight * np.sqrt(noise.variance)
    images.reshape(len(images), -1)[:, window.compared] = (moved_by * deviations[:, None]).T
    return covariance_of_sums(images, ((noise.dark, 1.0 - noise.brightness), (noise.bright, noise.brightness)))
