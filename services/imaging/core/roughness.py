"""How rough the distortion is, by restricted maximum likelihood: amplitude and length of the process, and the noise.

Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, section 5.4, with the linear part integrated out
(section 2.7). Both axes have the same covariance and the same polynomial, so that one factor serves both.
"""

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtrs
from scipy.optimize import minimize

from services.imaging.core.field_model import (
    SOURCE_TERMS,
    Array,
    FieldPrior,
    LinearSystem,
    correlation,
    distances_px,
    polynomial,
)

_SIMPLEX = np.diag([1.0, -0.7, 0.5])
_LOG_RANGE = (-7.0, 4.0)
_LENGTH_RANGE = (0.25, 4.0)
_NOISE_RANGE = (0.2, 20.0)
_TOLERANCE = 0.1


def most_likely_prior(system: LinearSystem, start: FieldPrior, evaluations: int) -> FieldPrior:
    """Roughness by restricted maximum likelihood, searched from `start` with so many evaluations at most."""
    likelihood = RestrictedLikelihood(system, start.order)

    def prior_of(x: Array) -> FieldPrior:
        amplitude, length, factor = np.exp(np.clip(x, *_LOG_RANGE))
        length_px = float(np.clip(length, *_LENGTH_RANGE)) * system.half_size_px
        return FieldPrior(start.order, float(amplitude), length_px, float(np.clip(factor, *_NOISE_RANGE)))

    first = np.log([start.amplitude_px, start.length_px / system.half_size_px, start.noise_factor])
    result = minimize(  # type: ignore[call-overload]  # the stubs refuse a simplex beside tolerances
        lambda x: -likelihood.of(prior_of(np.asarray(x, dtype=np.float64))),
        first,
        method="Nelder-Mead",
        options={
            "maxfev": evaluations,
            "xatol": _TOLERANCE,
            "fatol": _TOLERANCE,
            "initial_simplex": first + np.concatenate([np.zeros((1, 3)), _SIMPLEX]),
        },
    )
    return prior_of(np.asarray(result.x, dtype=np.float64))


class RestrictedLikelihood:
    """Log-likelihood of a system's roughness, up to a constant; what does not depend on it is worked out once."""

    def __init__(self, system: LinearSystem, order: int) -> None:
        measured = system.measured_px
        basis = polynomial(measured, system.centre_px, system.half_size_px, order)
        self._terms = basis.shape[1]
        self._distance = distances_px(measured, measured)
        self._variance = np.square(system.deviation_px)
        # Polynomial, source's slopes along x and y, targets along x and y: all that the factor has to be divided into.
        self._columns = np.asfortranarray(
            np.concatenate([basis, -system.slopes[:, 0], -system.slopes[:, 1], system.target_px], axis=1)
        )
        self._prior_mean, self._prior_weight = system.source_prior[0], system.source_prior[1] ** -2

    def of(self, prior: FieldPrior) -> float:
        """Log-likelihood; minus infinity where the covariance is not positive to rounding."""
        variance = prior.amplitude_px**2 * correlation(self._distance, prior.length_px)
        variance[np.diag_indices(len(variance))] += prior.noise_factor**2 * self._variance
        # Symmetric: its transpose is the column-major matrix that LAPACK factorises in place.
        factor, failed = dpotrf(variance.T, lower=1, overwrite_a=1)
        if failed:
            return -np.inf
        whitened, _ = dtrtrs(factor, self._columns, lower=1)
        information, gradient, squares = self._normal_equations(whitened.T @ whitened)
        root, failed = dpotrf(information, lower=1)
        if failed:
            return -np.inf
        explained, _ = dtrtrs(root, gradient, lower=1)
        quadratic = squares - float(explained @ explained)
        log_determinant = 4.0 * np.log(np.diag(factor)).sum() + 2.0 * np.log(np.diag(root)).sum()
        return float(-0.5 * (quadratic + log_determinant))

    def _normal_equations(self, gram: Array) -> tuple[Array, Array, float]:
        """Information and gradient of polynomial of x, of y, and source; and the sum of squares before they explain."""
        terms = self._terms
        along = [slice(terms + axis * SOURCE_TERMS, terms + (axis + 1) * SOURCE_TERMS) for axis in range(2)]
        polynomials, source = slice(0, terms), slice(2 * terms, None)
        information = np.zeros((2 * terms + SOURCE_TERMS,) * 2)
        gradient = np.zeros(len(information))
        information[source, source] = np.diag(self._prior_weight)
        gradient[source] = self._prior_weight * self._prior_mean
        squares = float(self._prior_weight @ np.square(self._prior_mean))
        for axis in range(2):
            rows, target = slice(axis * terms, (axis + 1) * terms), terms + 2 * SOURCE_TERMS + axis
            information[rows, rows] = gram[polynomials, polynomials]
            information[source, rows] = gram[along[axis], polynomials]
            information[source, source] += gram[along[axis], along[axis]]
            gradient[rows] = gram[polynomials, target]
            gradient[source] += gram[along[axis], target]
            squares += float(gram[target, target])
        return information, gradient, squares
