"""The smooth field from measured to ideal pixels: a polynomial plus a Gaussian process, solved with the source.

Given the hyperparameters everything is linear: displacement = polynomial + process + noise - slopes @ step, where
`step` corrects the assumed source. Generalised least squares yields coefficients and covariance (Rasmussen and
Williams, Gaussian Processes for Machine Learning, 2006, section 2.7). The hyperparameters (amplitude and length of the
process, noise) follow by restricted maximum likelihood (section 5.4): both axes have the same covariance and the same
polynomial, so that one factor serves both.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotrf, dtrtrs
from scipy.optimize import minimize

from services.imaging.core.tuning import DISTORTION_MODEL

Array = NDArray[np.float64]

# A source that is displaced has three coordinates.
SOURCE_TERMS = 3


@dataclass(frozen=True, slots=True)
class Hyperparameters:
    """Hyperparameters of the distortion.

    Attributes
    ----------
    order
        Total order of the polynomial.
    amplitude_px, length_px
        Of the Gaussian process (squared exponential: images bend smoothly. Matern 9/2, only four times
        differentiable, loses a twentieth at the rays, Matern 5/2 another tenth).
    noise_factor
        Ratio of real to predicted standard deviations of the balls' centres.
    """

    order: int
    amplitude_px: float
    length_px: float
    noise_factor: float


@dataclass(frozen=True, slots=True, eq=False)
class LinearSystem:
    """The problem linearised at a source.

    Attributes
    ----------
    measured_px, deviation_px
        Balls' centres, shape (N, 2), and their predicted standard deviation per axis, shape (N,).
    centre_px, half_size_px
        Scale of the polynomial's coordinates.
    target_px
        Ideal minus measured pixels at the assumed source, shape (N, 2).
    slopes
        Change of the ideal pixels with the source, shape (N, 2, 3).
    source_prior
        Nominal minus assumed source, and the nominal's standard deviation, shape (2, 3).
    """

    measured_px: Array
    deviation_px: Array
    centre_px: Array
    half_size_px: float
    target_px: Array
    slopes: Array
    source_prior: Array


@dataclass(frozen=True, slots=True, eq=False)
class FieldSolution:
    """Generalised least squares of a `LinearSystem` under a `Hyperparameters`.

    Attributes
    ----------
    coefficients, covariance
        Polynomial of x, polynomial of y, step of the source; shapes (P,) and (P, P).
    residual_px
        Target less the linear part, shape (N, 2): process and noise.
    """

    system: LinearSystem
    prior: Hyperparameters
    factor: tuple[Array, bool]
    whitened_design: Array
    coefficients: Array
    covariance: Array
    residual_px: Array

    @property
    def step_mm(self) -> Array:
        """Correction of the assumed source, shape (3,)."""
        return self.coefficients[-SOURCE_TERMS:]

    @property
    def source_covariance_mm2(self) -> Array:
        """Shape (3, 3)."""
        return self.covariance[-SOURCE_TERMS:, -SOURCE_TERMS:]

    def fit_residual_px(self) -> Array:
        """What is left for noise, shape (N, 2)."""
        noise = np.square(self.prior.noise_factor * self.system.deviation_px)
        return np.asarray(noise[:, None] * cho_solve(self.factor, self.residual_px))

    def left_out(self) -> tuple[Array, Array]:
        """Residuals with each ball left out, shape (N, 2), and their predicted deviation, shape (N,).

        From the inverse covariance with the linear part projected out (Rasmussen and Williams, equation 5.12).
        """
        count = len(self.residual_px)
        inverse = cho_solve(self.factor, np.eye(count))
        whitened = cho_solve(self.factor, self.residual_px)
        residual, variance = np.empty((count, 2)), np.zeros(count)
        for axis in range(2):
            design = self.whitened_design[axis]
            diagonal = np.diag(inverse) - np.sum(design @ self.covariance * design, axis=1)
            residual[:, axis] = whitened[:, axis] / diagonal
            variance += 0.5 / diagonal
        return residual, np.sqrt(variance)

    def predict(self, points_px: Array) -> tuple[Array, Array]:
        """Displacement at measured pixels, shape (P, 2), and its standard deviation per axis, shape (P,)."""
        system, prior = self.system, self.prior
        basis = polynomial(points_px, system.centre_px, system.half_size_px, prior.order)
        terms = basis.shape[1]
        cross = prior.amplitude_px**2 * correlation(distances_px(points_px, system.measured_px), prior.length_px)
        value = cross @ cho_solve(self.factor, self.residual_px)
        variance = prior.amplitude_px**2 - np.sum(cross * cho_solve(self.factor, cross.T).T, axis=1)
        for axis in range(2):
            rows = slice(axis * terms, (axis + 1) * terms)
            value[:, axis] += basis @ self.coefficients[rows]
            lever = -cross @ self.whitened_design[axis]
            lever[:, rows] += basis
            variance += 0.5 * np.sum(lever @ self.covariance * lever, axis=1)
        return value, np.sqrt(np.maximum(variance, 0.0))


def polynomial(points_px: Array, centre_px: Array, half_size_px: float, order: int) -> Array:
    """Monomials up to a total order, shape (N, terms), of pixels scaled to about [-1, 1]."""
    x, y = ((points_px - centre_px) / half_size_px).T
    return np.stack([x**i * y**j for i in range(order + 1) for j in range(order + 1 - i)], axis=1)


def distances_px(a_px: Array, b_px: Array) -> Array:
    """Distance of each point of the one from each of the other, shape (N, M)."""
    dx, dy = a_px[:, None, 0] - b_px[None, :, 0], a_px[:, None, 1] - b_px[None, :, 1]
    return np.asarray(np.sqrt(dx**2 + dy**2))


def correlation(distance_px: Array, length_px: float) -> Array:
    """Of the process between points at these distances: the squared exponential."""
    return np.asarray(np.exp(-0.5 * np.square(distance_px / length_px)))


def solve_field(system: LinearSystem, prior: Hyperparameters) -> FieldSolution:
    """Generalised least squares of both axes and the source together."""
    design = _design(system, prior.order)
    count = design.shape[1]
    variance = prior.amplitude_px**2 * correlation(
        distances_px(system.measured_px, system.measured_px), prior.length_px
    )
    variance[np.diag_indices(count)] += np.square(prior.noise_factor * system.deviation_px)
    factor = cho_factor(variance, lower=True)
    whitened = cho_solve(factor, np.concatenate([design[0], design[1]], axis=1))
    whitened_design = np.stack(np.split(whitened, 2, axis=1))
    information = design[0].T @ whitened_design[0] + design[1].T @ whitened_design[1]
    gradient = whitened_design[0].T @ system.target_px[:, 0] + whitened_design[1].T @ system.target_px[:, 1]
    tail = np.arange(-SOURCE_TERMS, 0)
    weight = system.source_prior[1] ** -2
    information[tail, tail] += weight
    gradient[tail] += system.source_prior[0] * weight
    covariance = np.linalg.inv(information)
    coefficients = covariance @ gradient
    residual = system.target_px - np.stack([design[0] @ coefficients, design[1] @ coefficients], axis=1)
    return FieldSolution(system, prior, factor, whitened_design, coefficients, covariance, residual)


def _design(system: LinearSystem, order: int) -> Array:
    """Columns of the linear part for both axes, shape (2, N, P)."""
    basis = polynomial(system.measured_px, system.centre_px, system.half_size_px, order)
    count, terms = basis.shape
    design = np.zeros((2, count, 2 * terms + SOURCE_TERMS))
    for axis in range(2):
        design[axis, :, axis * terms : (axis + 1) * terms] = basis
        design[axis, :, -SOURCE_TERMS:] = -system.slopes[:, axis]
    return design


# First steps of the logarithms of amplitude, length and noise: factors of two or so. The range is a guard.
_SIMPLEX = np.diag([1.0, -0.7, 0.5])
_LOG_RANGE = (-7.0, 4.0)


def most_likely_hyperparameters(system: LinearSystem, start: Hyperparameters, evaluations: int) -> Hyperparameters:
    """Maximise the restricted likelihood from `start`, with so many evaluations at most."""
    likelihood = RestrictedLikelihood(system, start.order)

    def hyperparameters_of(x: Array) -> Hyperparameters:
        amplitude, length, factor = np.exp(np.clip(x, *_LOG_RANGE))
        length_px = float(np.clip(length, *DISTORTION_MODEL.length_range)) * system.half_size_px
        return Hyperparameters(
            start.order, float(amplitude), length_px, float(np.clip(factor, *DISTORTION_MODEL.noise_range))
        )

    first = np.log([start.amplitude_px, start.length_px / system.half_size_px, start.noise_factor])
    result = minimize(  # type: ignore[call-overload]  # the stubs refuse a simplex beside tolerances
        lambda x: -likelihood.of(hyperparameters_of(np.asarray(x, dtype=np.float64))),
        first,
        method="Nelder-Mead",
        options={
            "maxfev": evaluations,
            "xatol": DISTORTION_MODEL.log_tolerance,
            "fatol": DISTORTION_MODEL.log_tolerance,
            "initial_simplex": first + np.concatenate([np.zeros((1, 3)), _SIMPLEX]),
        },
    )
    return hyperparameters_of(np.asarray(result.x, dtype=np.float64))


class RestrictedLikelihood:
    """Log-likelihood of hyperparameters, up to a constant; what does not depend on them is computed once."""

    def __init__(self, system: LinearSystem, order: int) -> None:
        measured = system.measured_px
        basis = polynomial(measured, system.centre_px, system.half_size_px, order)
        self._terms = basis.shape[1]
        self._distance = distances_px(measured, measured)
        self._variance = np.square(system.deviation_px)
        # Polynomial, source's slopes along x and y, targets along x and y: all that is whitened by the factor.
        self._columns = np.asfortranarray(
            np.concatenate([basis, -system.slopes[:, 0], -system.slopes[:, 1], system.target_px], axis=1)
        )
        self._prior_mean, self._prior_weight = system.source_prior[0], system.source_prior[1] ** -2

    def of(self, prior: Hyperparameters) -> float:
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
