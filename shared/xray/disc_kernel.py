"""Compiled inner loops of the disc fits: one group of discs at a time, damped Gauss-Newton, robust."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shared.compiled import compiled, compiled_fast
from shared.xray.disc_model import BACKGROUND_TERMS, model_rows
from shared.xray.disc_samples import neighbours
from shared.xray.tuning import DEVIATION_PER_MEDIAN, DISC_FITTING

Array = NDArray[np.float64]


class FitConstants(NamedTuple):
    """What `DISC_FITTING` gives the compiled fits, which cannot read it themselves."""

    huber: float
    opacity: float
    contrast: float
    overlap: float
    overlap_sd: float
    curvature_precision: float
    least_pixels: int
    first_iterations: int
    next_iterations: int
    first_noise: float
    least_noise: float
    neighbour_sigmas: float
    least_radius: float
    greatest_radius: float
    greatest_overlap: float
    least_blur_px: float
    greatest_blur_px: float
    first_damping: float
    singular_factor: float
    failed_factor: float
    gained_factor: float
    greatest_damping: float
    least_gain: float


def fit_constants() -> FitConstants:
    """The tuned values of the fits as they are now."""
    return FitConstants(*(getattr(DISC_FITTING, name) for name in FitConstants._fields))


@compiled_fast
def normal_equations(rows: Array, residual: Array, weight: Array, normal: Array, gradient: Array) -> float:
    """Weighted normal matrix (lower triangle) and gradient of one group; returns the weighted sum of squares."""
    size, count = rows.shape
    scaled = np.empty(count)
    cost = 0.0
    for n in range(count):
        cost += weight[n] * residual[n] * residual[n]
    for i in range(size):
        row, total = rows[i], 0.0
        for n in range(count):
            scaled[n] = weight[n] * row[n]
            total += scaled[n] * residual[n]
        gradient[i] = total
        for j in range(i + 1):
            other, total = rows[j], 0.0
            for n in range(count):
                total += scaled[n] * other[n]
            normal[i, j] = total
    return cost


@compiled_fast
def factorise(matrix: Array) -> bool:
    """Cholesky factor in the lower triangle, in place; False when the matrix is not positive."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i == j:
                if total <= 0.0:
                    return False
                matrix[i, i] = math.sqrt(total)
            else:
                matrix[i, j] = total / matrix[j, j]
    return True


@compiled_fast
def solve_cholesky(normal: Array, gradient: Array, damping: float, step: Array) -> bool:
    """Solve (normal + damping * its diagonal) step = gradient; False when the matrix is not positive."""
    size = len(gradient)
    factor = normal.copy()
    for i in range(size):
        factor[i, i] *= 1.0 + damping
    if not factorise(factor):
        return False
    for i in range(size):
        total = gradient[i]
        for k in range(i):
            total -= factor[i, k] * step[k]
        step[i] = total / factor[i, i]
    for i in range(size - 1, -1, -1):
        total = step[i]
        for k in range(i + 1, size):
            total -= factor[k, i] * step[k]
        step[i] = total / factor[i, i]
    return True


@compiled_fast
def clip_parameters(p: Array, mean: Array, discs: int, fit: FitConstants) -> None:
    """Guard: keep radii and blur positive and within a patch, and overlaps between sum and union of shadows."""
    first = BACKGROUND_TERMS + 3 * discs
    for k in range(first, first + discs):
        p[k] = min(max(p[k], fit.least_radius * mean[k]), fit.greatest_radius * mean[k])
    p[-2] = min(max(p[-2], 0.0), fit.greatest_overlap)
    p[-1] = min(max(p[-1], fit.least_blur_px), fit.greatest_blur_px)


@compiled_fast
def _evaluate(
    samples: Array,
    weight: Array,
    frame: Array,
    p: Array,
    mean: Array,
    precision: Array,
    discs: int,
    opacity: float,
    normal: Array,
    gradient: Array,
    rows: Array,
    residual: Array,
) -> float:
    """Cost with priors at `p`; fills normal matrix, gradient and residuals."""
    model_rows(samples, frame, p, discs, opacity, rows, residual)
    for n in range(len(residual)):
        residual[n] = samples[n, 2] - residual[n]
    cost = normal_equations(rows, residual, weight, normal, gradient)
    for i in range(len(p)):
        off = p[i] - mean[i]
        cost += precision[i] * off * off
        normal[i, i] += precision[i]
        gradient[i] -= precision[i] * off
    return cost


@compiled_fast
def levenberg(
    samples: Array,
    weight: Array,
    frame: Array,
    p: Array,
    mean: Array,
    precision: Array,
    discs: int,
    fit: FitConstants,
    iterations: int,
    rows: Array,
    residual: Array,
) -> Array:
    """Minimise weighted squares plus priors from `p`, in place; returns the normal matrix (lower triangle) there."""
    size = len(p)
    normal, trial_normal = np.empty((size, size)), np.empty((size, size))
    gradient, trial_gradient = np.empty(size), np.empty(size)
    opacity = fit.opacity
    step, trial, trial_residual = np.zeros(size), np.empty(size), np.empty(len(residual))
    cost = _evaluate(samples, weight, frame, p, mean, precision, discs, opacity, normal, gradient, rows, residual)
    damping = fit.first_damping
    for _ in range(iterations):
        if not solve_cholesky(normal, gradient, damping, step):
            damping *= fit.singular_factor
            continue
        trial[:] = p + step
        clip_parameters(trial, mean, discs, fit)
        trial_cost = _evaluate(
            samples,
            weight,
            frame,
            trial,
            mean,
            precision,
            discs,
            opacity,
            trial_normal,
            trial_gradient,
            rows,
            trial_residual,
        )
        if trial_cost < cost:
            gain = (cost - trial_cost) / (cost + 1e-12)
            p[:], residual[:] = trial, trial_residual
            normal[:], gradient[:], cost = trial_normal, trial_gradient, trial_cost
            damping *= fit.gained_factor
            if gain < fit.least_gain:
                break
        else:
            damping = max(damping, fit.first_damping) * fit.failed_factor
            if damping > fit.greatest_damping:
                break
    return normal


@compiled_fast
def fit_group(
    samples: Array, frame: Array, mean: Array, precision: Array, discs: int, passes: int, fit: FitConstants
) -> tuple[Array, Array, Array, float, tuple[float, float]]:
    """Robust fit of one group.

    Parameters
    ----------
    samples
        Columns x, y and normalised grey value of the pixels that count, shape (P, 3).
    frame
        Centre x, y and scale of the background's coordinates, shape (3,).
    mean, precision
        Start and priors of the parameters, shape (M,).
    discs
        Number of discs.
    passes
        Rounds of re-weighting.
    fit
        Tuned values.

    Returns
    -------
    tuple
        Parameters, inverse covariance (lower triangle), residuals, their robust noise, and of residuals of neighbours
        in a row the correlation and the mean squared difference.
    """
    p = mean.copy()
    count = len(samples)
    rows, residual = np.empty((len(p), count)), np.empty(count)
    noise = fit.first_noise
    weight = np.full(count, 1.0 / noise**2)
    normal = np.tril(
        levenberg(samples, weight, frame, p, mean, precision, discs, fit, fit.first_iterations, rows, residual)
    )
    for _ in range(passes):
        for n in range(count):
            residual[n] = abs(residual[n])
        noise = max(DEVIATION_PER_MEDIAN * np.median(residual), fit.least_noise)
        for n in range(count):
            weight[n] = min(1.0, fit.huber * noise / max(residual[n], 1e-12)) / noise**2
        normal = np.tril(
            levenberg(samples, weight, frame, p, mean, precision, discs, fit, fit.next_iterations, rows, residual)
        )
    return p, normal, residual, noise, neighbours(samples, residual, fit.neighbour_sigmas * noise)


@compiled
def uncertainties(normal: Array, discs: int) -> tuple[Array, Array]:
    """Of a fit's normal matrix (lower triangle): covariance of each centre, shape (K, 2, 2), and variance of each
    contrast when place, size and blur are given, shape (K,).
    """
    whole = normal + normal.T
    for i in range(len(whole)):
        whole[i, i] *= 0.5
    covariance = np.linalg.inv(whole)
    depths = BACKGROUND_TERMS + discs
    given = np.linalg.inv(np.ascontiguousarray(whole[:depths, :depths]))
    centre, contrast = np.empty((discs, 2, 2)), np.empty(discs)
    for k in range(discs):
        x, y = depths + k, depths + discs + k
        centre[k, 0, 0], centre[k, 0, 1] = covariance[x, x], covariance[x, y]
        centre[k, 1, 0], centre[k, 1, 1] = covariance[y, x], covariance[y, y]
        contrast[k] = given[BACKGROUND_TERMS + k, BACKGROUND_TERMS + k]
    return centre, contrast
