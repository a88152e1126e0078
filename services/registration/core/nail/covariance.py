"""How far the fitted pose may be off: the fit's own curvature, corrected for noise that is correlated between pixels."""

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.linalg import cho_solve

from services.registration.core.nail.image_model import NailScene
from services.registration.core.nail.noise import Correlation
from services.registration.core.nail.pose import POSE_SIZE
from services.registration.core.nail.solver import Problem, Solution, cross_terms

_STEP = np.array([0.01, 0.01, 0.01, 0.01, 1e-4, 1e-4])


def parameter_covariance(problem: Problem, solution: Solution, correlation: Correlation) -> NDArray[np.float64]:
    """Covariance of the free parameters, shape (P, P).

    With H the projected normal matrix (priors included) and J the whitened projected sensitivities, an estimator that
    takes pixels for independent has the covariance H⁻¹ (H + J'(R - 1)J) H⁻¹ when the noise has the correlation R.
    """
    inverse = np.linalg.inv(solution.normal_matrix)
    projected = _projected_sensitivities(problem, solution)
    spectrum_terms = _correlated_products(problem, projected, correlation)
    excess = spectrum_terms - projected.T @ projected
    covariance = inverse @ (solution.normal_matrix + excess) @ inverse
    return np.asarray(0.5 * (covariance + covariance.T))


def pose_covariance(
    scene: NailScene, parameters: NDArray[np.float64], covariance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Covariance of a small motion of the nail in its own frame, shape (6, 6): rotation vector (rad), translation (mm).

    The true pose is `camera_from_nail @ motion` with `motion` this small motion; `covariance` is that of the first six
    parameters, shape (6, 6).
    """
    base = scene.pose(parameters).inverse()
    columns = []
    for k in range(POSE_SIZE):
        moved = parameters.copy()
        moved[k] += _STEP[k]
        motion = base @ scene.pose(moved)
        columns.append(np.concatenate([motion.rotation_vector_rad, motion.translation_mm]) / _STEP[k])
    jacobian = np.column_stack(columns)
    return np.asarray(jacobian @ covariance @ jacobian.T)


def _projected_sensitivities(problem: Problem, solution: Solution) -> NDArray[np.float64]:
    """Sensitivities less what background and floor can imitate, in standard deviations, shape (N, P)."""
    linear = solution.linear
    look = linear.appearance
    gain = look.visible * look.delrin
    dense = (1.0 - look.visible)[:, None] * problem.floor
    cross = cross_terms(problem, gain, dense, solution.sensitivities)
    coefficients = cho_solve(linear.factor, cross, check_finite=False)
    size = problem.field.size
    imitated = dense @ coefficients[size:]
    for k in range(imitated.shape[1]):
        imitated[:, k] += gain * problem.field.at_places(np.ascontiguousarray(coefficients[:size, k]))
    return np.asarray(np.sqrt(problem.weight)[:, None] * (solution.sensitivities - imitated))


def _correlated_products(
    problem: Problem, columns: NDArray[np.float64], correlation: Correlation
) -> NDArray[np.float64]:
    """J'RJ for columns J that live on the compared pixels, by the correlation's power spectrum."""
    window = problem.scene.window
    reach = correlation.by_lag.shape[0] // 2
    padded = tuple(fft.next_fast_len(side + 2 * reach, real=True) for side in window.shape)
    spectrum = correlation.power(padded)
    spectra = []
    for column in columns.T:
        image = np.zeros(window.shape)
        image.ravel()[window.compared] = column
        spectra.append((fft.fft2(image, padded) * np.sqrt(spectrum)).ravel())
    stacked = np.array(spectra)
    return np.asarray((stacked @ stacked.conj().T).real / spectrum.size)
