"""Source position and distortion from the ring's balls, estimated together.

The ring's plane z = 0 is the ideal image plane: a ball at (p, z) appears there, seen from the source s at height S, at
q = s + (p - s) S / (S + z). What leads from measured pixels to that plane is one smooth field: a cubic polynomial plus
a Gaussian process (Matern 5/2). Given the field's roughness the problem is linear but for a mild dependence on S, so
that generalised least squares yields source, field and their covariance; restricted likelihood sets the roughness.
(Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, sections 2.7 and 5.4.)
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

Array = NDArray[np.float64]

_SOURCE_TERMS = 3
_OUTLIER = 4.0
_LEAST_DEVIATION_PX = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Gauge:
    """Similarity from the ring's plane z = 0 (mm) to ideal pixels: `pixel = scale * rotation @ q + offset`."""

    scale_px_per_mm: float
    rotation: Array
    offset_px: Array

    def pixels(self, plane_mm: Array) -> Array:
        """Ideal pixels, shape (N, 2), of points of the plane, shape (N, 2)."""
        return np.asarray(self.scale_px_per_mm * plane_mm @ self.rotation.T + self.offset_px)


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Measured balls.

    Attributes
    ----------
    measured_px, deviation_px
        Centres, shape (N, 2), and their predicted standard deviation per axis, shape (N,).
    position_mm
        In the ring's frame, shape (N, 3).
    """

    measured_px: Array
    deviation_px: Array
    position_mm: Array

    def select(self, keep: NDArray[np.bool_]) -> "Observations":
        """Those that are marked."""
        return Observations(self.measured_px[keep], self.deviation_px[keep], self.position_mm[keep])


@dataclass(frozen=True, slots=True)
class FieldPrior:
    """Roughness of the distortion: Gaussian process amplitude and length, and what the predicted noise is off by."""

    order: int
    amplitude_px: float
    length_px: float
    noise_factor: float


@dataclass(frozen=True, slots=True, eq=False)
class JointEstimate:
    """Source and distortion with their uncertainty.

    Attributes
    ----------
    source_mm
        Focal spot in the ring's frame, shape (3,).
    source_covariance_mm2
        Shape (3, 3).
    gauge
        From the ring's plane to ideal pixels.
    used
        Which observations were used, shape (N,); the others disagree with all the rest.
    residual_px, left_out_px
        Residuals of the fit and those with each ball left out of it, shape (N, 2), NaN where not used.
    """

    source_mm: Array
    source_covariance_mm2: Array
    gauge: Gauge
    prior: FieldPrior
    used: NDArray[np.bool_]
    residual_px: Array
    left_out_px: Array
    _system: "_System"
    _solution: "_Solution"

    def field(self, points_px: Array) -> tuple[Array, Array]:
        """Displacement from measured to ideal pixels, shape (P, 2), and its standard deviation per axis, shape (P,)."""
        return _posterior(self._system, self._solution, self.prior, points_px)


@dataclass(frozen=True, slots=True, eq=False)
class _System:
    """The problem linearised at a source: displacement = basis @ beta - slopes @ step + field + noise."""

    measured_px: Array
    deviation_px: Array
    centre_px: Array
    half_size_px: float
    target: Array
    slopes: Array
    source_prior: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Solution:
    factor: tuple[Array, bool]
    design: Array
    coefficients: Array
    covariance: Array
    residual: Array
    whitened_design: Array
    log_likelihood: float


def estimate_jointly(
    observations: Observations, source_start_mm: Array, gauge: Gauge, source_sd_mm: Array
) -> JointEstimate:
    """Estimate source and distortion; balls that disagree with all the rest are left out.

    Parameters
    ----------
    observations
        Measured balls of the ring.
    source_start_mm, source_sd_mm
        Nominal focal spot in the ring's frame and how well it is known, shape (3,) each.
    gauge
        What ideal pixels are.

    Returns
    -------
    JointEstimate
        With the roughness that makes the observations most likely.
    """
    used = np.ones(len(observations.deviation_px), dtype=bool)
    source = source_start_mm
    while True:
        chosen = observations.select(used)
        system, solution, prior, source = _converge(chosen, source, source_start_mm, source_sd_mm, gauge)
        left_out, left_out_sd = _left_out(system, solution, prior)
        worst = np.abs(left_out / left_out_sd[:, None]).max(axis=1)
        bad = worst > max(_OUTLIER, 0.6 * float(worst.max()))
        if not bad.any() or np.count_nonzero(used) - np.count_nonzero(bad) < 12:
            break
        used[np.flatnonzero(used)[bad]] = False
    return _estimate(observations, used, source, gauge, (system, solution, prior))


def _converge(
    observations: Observations, source: Array, nominal: Array, nominal_sd: Array, gauge: Gauge
) -> tuple[_System, _Solution, FieldPrior, Array]:
    prior: FieldPrior | None = None
    for _ in range(3):
        system = _linearised(observations, source, nominal, nominal_sd, gauge)
        prior = _most_likely(system) if prior is None else prior
        solution = _solve(system, prior)
        step = solution.coefficients[-_SOURCE_TERMS:]
        source = source + step
        if float(np.abs(step).max()) < 1e-3:
            break
    system = _linearised(observations, source, nominal, nominal_sd, gauge)
    prior = _most_likely(system)
    solution = _solve(system, prior)
    return system, solution, prior, source + solution.coefficients[-_SOURCE_TERMS:]


def on_plane(position_mm: Array, source_mm: Array) -> Array:
    """Where balls at `position_mm`, shape (N, 3), appear on the plane z = 0 seen from the source, shape (N, 2)."""
    height = -source_mm[2]
    magnification = height / (height + position_mm[:, 2])
    return np.asarray(source_mm[:2] + (position_mm[:, :2] - source_mm[:2]) * magnification[:, None])


def _linearised(
    observations: Observations, source: Array, nominal: Array, nominal_sd: Array, gauge: Gauge
) -> _System:
    ideal = gauge.pixels(on_plane(observations.position_mm, source))
    steps = np.array([0.1, 0.1, 1.0])
    slopes = np.stack(
        [
            (gauge.pixels(on_plane(observations.position_mm, source + step)) - ideal) / steps[k]
            for k, step in enumerate(np.diag(steps))
        ],
        axis=-1,
    )
    centre = 0.5 * (observations.measured_px.min(axis=0) + observations.measured_px.max(axis=0))
    return _System(
        measured_px=observations.measured_px,
        deviation_px=np.maximum(observations.deviation_px, _LEAST_DEVIATION_PX),
        centre_px=centre,
        half_size_px=float(0.5 * np.ptp(observations.measured_px, axis=0).max()),
        target=ideal - observations.measured_px,
        slopes=slopes,
        source_prior=np.stack([nominal - source, nominal_sd]),
    )


def polynomial(points_px: Array, centre_px: Array, half_size_px: float, order: int) -> Array:
    """Monomials up to a total order, shape (N, terms), of pixels scaled to about [-1, 1]."""
    x, y = ((points_px - centre_px) / half_size_px).T
    return np.stack([x**i * y**j for i in range(order + 1) for j in range(order + 1 - i)], axis=1)


def matern52(a_px: Array, b_px: Array, length_px: float) -> Array:
    """Correlation between points, shape (N, M)."""
    square = np.square(a_px[:, None] - b_px[None]).sum(axis=2)
    r = np.sqrt(5.0 * square) / length_px
    return np.asarray((1.0 + r + r**2 / 3.0) * np.exp(-r))


def _solve(system: _System, prior: FieldPrior) -> _Solution:
    """Generalised least squares of both axes and the source together."""
    basis = polynomial(system.measured_px, system.centre_px, system.half_size_px, prior.order)
    count, terms = basis.shape
    variance = prior.amplitude_px**2 * matern52(system.measured_px, system.measured_px, prior.length_px)
    variance[np.diag_indices(count)] += (prior.noise_factor * system.deviation_px) ** 2
    factor = cho_factor(variance, lower=True)
    design = np.zeros((2, count, 2 * terms + _SOURCE_TERMS))
    for axis in range(2):
        design[axis, :, axis * terms : (axis + 1) * terms] = basis
        design[axis, :, -_SOURCE_TERMS:] = -system.slopes[:, axis]
    whitened_design = np.stack([cho_solve(factor, design[axis]) for axis in range(2)])
    information = np.einsum("anp,anq->pq", design, whitened_design)
    gradient = np.einsum("anp,na->p", whitened_design, system.target)
    tail = np.arange(-_SOURCE_TERMS, 0)
    information[tail, tail] += system.source_prior[1] ** -2
    gradient[tail] += system.source_prior[0] * system.source_prior[1] ** -2
    covariance = np.linalg.inv(information)
    coefficients = covariance @ gradient
    residual = system.target - np.einsum("anp,p->na", design, coefficients)
    quadratic = float(np.sum(residual * cho_solve(factor, residual)))
    log_determinant = 4.0 * float(np.log(np.diag(factor[0])).sum()) + float(np.linalg.slogdet(information)[1])
    likelihood = -0.5 * (quadratic + log_determinant)
    return _Solution(factor, design, coefficients, covariance, residual, whitened_design, likelihood)


def _most_likely(system: _System) -> FieldPrior:
    """Roughness by restricted maximum likelihood."""
    start = np.log([0.5, 1.0, 1.5])

    def prior_of(x: Array) -> FieldPrior:
        amplitude, length, factor = np.exp(np.clip(x, -12.0, 5.0))
        length = float(np.clip(length, 0.25, 4.0))
        return FieldPrior(3, float(amplitude), length * system.half_size_px, float(np.clip(factor, 0.2, 20.0)))

    def loss(x: Array) -> float:
        return -_solve(system, prior_of(x)).log_likelihood

    simplex = start + np.concatenate([np.zeros((1, 3)), np.diag([1.0, -0.7, 0.5])])
    options = {"maxfev": 90, "xatol": 0.05, "fatol": 0.05, "initial_simplex": simplex}
    result = minimize(loss, start, method="Nelder-Mead", options=options)
    return prior_of(np.asarray(result.x))


def _left_out(system: _System, solution: _Solution, prior: FieldPrior) -> tuple[Array, Array]:
    """Residuals with each ball left out, shape (N, 2), and their predicted deviation, shape (N,).

    From the inverse covariance with the linear part projected out (Rasmussen and Williams, equation 5.12).
    """
    del prior
    count = len(system.target)
    inverse = cho_solve(solution.factor, np.eye(count))
    residual = np.empty((count, 2))
    variance = np.zeros(count)
    for axis in range(2):
        projected = solution.whitened_design[axis]
        reduced = inverse - projected @ solution.covariance @ projected.T
        diagonal = np.diag(reduced)
        residual[:, axis] = (cho_solve(solution.factor, solution.residual[:, axis])) / diagonal
        variance += 0.5 / diagonal
    return residual, np.sqrt(variance)


def _posterior(
    system: _System, solution: _Solution, prior: FieldPrior, points_px: Array
) -> tuple[Array, Array]:
    basis = polynomial(points_px, system.centre_px, system.half_size_px, prior.order)
    terms = basis.shape[1]
    cross = prior.amplitude_px**2 * matern52(points_px, system.measured_px, prior.length_px)
    weights = cho_solve(solution.factor, solution.residual)
    value = cross @ weights
    spread = prior.amplitude_px**2 - np.einsum("pn,np->p", cross, cho_solve(solution.factor, cross.T))
    variance = np.zeros(len(points_px))
    for axis in range(2):
        rows = slice(axis * terms, (axis + 1) * terms)
        value[:, axis] += basis @ solution.coefficients[rows]
        lever = -cross @ solution.whitened_design[axis]
        lever[:, rows] += basis
        variance += 0.5 * (spread + np.einsum("pi,ij,pj->p", lever, solution.covariance, lever))
    return value, np.sqrt(np.maximum(variance, 0.0))


def _estimate(
    observations: Observations,
    used: NDArray[np.bool_],
    source: Array,
    gauge: Gauge,
    parts: tuple[_System, _Solution, FieldPrior],
) -> JointEstimate:
    system, solution, prior = parts
    left_out, _ = _left_out(system, solution, prior)
    shape = (len(used), 2)
    residual_px, left_out_px = np.full(shape, np.nan), np.full(shape, np.nan)
    count = len(system.target)
    inverse_residual = cho_solve(solution.factor, solution.residual)
    noise = (prior.noise_factor * system.deviation_px) ** 2
    residual_px[used] = noise[:, None] * inverse_residual
    left_out_px[used] = left_out
    assert count == np.count_nonzero(used)
    covariance = solution.covariance[-_SOURCE_TERMS:, -_SOURCE_TERMS:]
    return JointEstimate(source, covariance, gauge, prior, used, residual_px, left_out_px, system, solution)


def with_order(prior: FieldPrior, order: int) -> FieldPrior:
    """The same roughness on another polynomial."""
    return replace(prior, order=order)
