"""Compiled inner loops of the disc fits: one group of discs at a time, damped Gauss-Newton.

The parameters of a group of K discs are, in this order: background (6: constant, slopes, curvatures), then contrast,
x, y and radius of each disc, then the depth of overlaps and the blur. `discs.py` says what they mean.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

BACKGROUND_TERMS = 6
_ROOT_2 = math.sqrt(2.0)
_ROOT_2PI = math.sqrt(2.0 * math.pi)
_MAX_DAMPING = 1e3


@njit(cache=True, fastmath=True, error_model="numpy")
def model_row(x: float, y: float, frame: Array, p: Array, discs: int, row: Array) -> float:
    """Grey value of the model at one pixel; `row` receives its derivatives by the parameters."""
    b = BACKGROUND_TERMS
    u, v = (x - frame[0]) / frame[2], (y - frame[1]) / frame[2]
    row[0], row[1], row[2], row[3], row[4], row[5] = 1.0, u, v, u * u, u * v, v * v
    grey = 0.0
    for i in range(b):
        grey += row[i] * p[i]
    overlap, blur = p[-2], p[-1]
    row[-1], row[-2] = 0.0, 0.0
    for k in range(discs):
        z = (math.hypot(x - p[b + discs + k], y - p[b + 2 * discs + k]) - p[b + 3 * discs + k]) / blur
        row[b + k] = 0.5 * math.erfc(z / _ROOT_2)  # kept here until the overlaps are done
    for k in range(discs):
        shade = row[b + k]
        slope = p[b + k]
        for j in range(discs):
            if j != k:
                slope -= overlap * max(min(p[b + k], p[b + j]), 0.0) * row[b + j]
        dx, dy = x - p[b + discs + k], y - p[b + 2 * discs + k]
        distance = math.sqrt(dx * dx + dy * dy) + 1e-9
        z = (distance - p[b + 3 * discs + k]) / blur
        along = -slope * math.exp(-0.5 * z * z) / (_ROOT_2PI * blur)
        row[b + discs + k] = along * dx / distance
        row[b + 2 * discs + k] = along * dy / distance
        row[b + 3 * discs + k] = along
        row[-1] += along * z
        grey -= p[b + k] * shade
    return grey + _overlaps(p, discs, row)


@njit(cache=True, fastmath=True, error_model="numpy")
def _overlaps(p: Array, discs: int, row: Array) -> float:
    """What overlaps take back of the summed shadows; turns the shades kept in `row` into derivatives by contrast."""
    b = BACKGROUND_TERMS
    overlap = p[-2]
    common = 0.0
    shade = row[b : b + discs].copy()
    for k in range(discs):
        row[b + k] = -shade[k]
    for k in range(discs):
        for j in range(k + 1, discs):
            both = shade[k] * shade[j]
            # Of two shadows the darker one stays: with overlap 1 the fainter one adds nothing.
            fainter = k if p[b + k] < p[b + j] else j
            if p[b + fainter] > 0.0:
                common += p[b + fainter] * both
                row[b + fainter] += overlap * both
    row[-2] = common
    return float(overlap * common)


@njit(cache=True, fastmath=True, error_model="numpy")
def normal_equations(
    pixels: Array, weight: Array, frame: Array, p: Array, discs: int, normal: Array, gradient: Array
) -> float:
    """Weighted normal matrix (lower triangle) and gradient of one group; returns the weighted sum of squares."""
    size = len(p)
    row = np.empty(size)
    normal[:] = 0.0
    gradient[:] = 0.0
    cost = 0.0
    for n in range(len(pixels)):
        residual = pixels[n, 2] - model_row(pixels[n, 0], pixels[n, 1], frame, p, discs, row)
        w = weight[n]
        cost += w * residual * residual
        for i in range(size):
            scaled = w * row[i]
            gradient[i] += scaled * residual
            for j in range(i + 1):
                normal[i, j] += scaled * row[j]
    return cost


@njit(cache=True, fastmath=True, error_model="numpy")
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


@njit(cache=True, fastmath=True, error_model="numpy")
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


@njit(cache=True, fastmath=True, error_model="numpy")
def clip_parameters(p: Array, mean: Array, discs: int) -> None:
    """Keep radii and blur positive, and overlaps between sum and union of shadows."""
    first = BACKGROUND_TERMS + 3 * discs
    for k in range(first, first + discs):
        p[k] = min(max(p[k], 0.4 * mean[k]), 1.6 * mean[k])
    p[-2] = min(max(p[-2], 0.0), 1.2)
    p[-1] = min(max(p[-1], 0.4), 4.0)


@njit(cache=True, fastmath=True, error_model="numpy")
def levenberg(
    pixels: Array, weight: Array, frame: Array, p: Array, mean: Array, precision: Array, discs: int, iterations: int
) -> Array:
    """Minimise weighted squares plus priors from `p`, in place; returns the normal matrix (lower triangle) there."""
    size = len(p)
    normal, trial_normal = np.empty((size, size)), np.empty((size, size))
    gradient, trial_gradient = np.empty(size), np.empty(size)
    step, trial = np.zeros(size), np.empty(size)
    cost = _with_priors(
        normal_equations(pixels, weight, frame, p, discs, normal, gradient), p, mean, precision, normal, gradient
    )
    damping = 1e-2
    for _ in range(iterations):
        if not solve_cholesky(normal, gradient, damping, step):
            damping *= 10.0
            continue
        trial[:] = p + step
        clip_parameters(trial, mean, discs)
        squares = normal_equations(pixels, weight, frame, trial, discs, trial_normal, trial_gradient)
        trial_cost = _with_priors(squares, trial, mean, precision, trial_normal, trial_gradient)
        if trial_cost < cost:
            gain = (cost - trial_cost) / (cost + 1e-12)
            p[:] = trial
            normal[:], gradient[:], cost = trial_normal, trial_gradient, trial_cost
            damping *= 0.15
            if gain < 1e-5:
                break
        else:
            damping = max(damping, 1e-3) * 8.0
            if damping > _MAX_DAMPING:
                break
    return normal


@njit(cache=True, fastmath=True, error_model="numpy")
def _with_priors(cost: float, p: Array, mean: Array, precision: Array, normal: Array, gradient: Array) -> float:
    """Add the priors to cost, normal matrix and gradient."""
    for i in range(len(p)):
        off = p[i] - mean[i]
        cost += precision[i] * off * off
        normal[i, i] += precision[i]
        gradient[i] -= precision[i] * off
    return cost


@njit(cache=True, fastmath=True, error_model="numpy")
def fit_group(
    pixels: Array, frame: Array, mean: Array, precision: Array, discs: int, passes: int, huber: float
) -> tuple[Array, Array, float]:
    """Robust fit of one group.

    Parameters
    ----------
    pixels
        Columns x, y and normalised grey value of the pixels that count, shape (P, 3).
    frame
        Centre x, y and scale of the background's coordinates, shape (3,).
    mean, precision
        Start and priors of the parameters, shape (M,).
    discs
        Number of discs.
    passes
        Rounds of re-weighting.
    huber
        Residual, in standard deviations, beyond which a pixel counts less.

    Returns
    -------
    tuple
        Parameters, inverse covariance (lower triangle) and robust residual noise.
    """
    p = mean.copy()
    count = len(pixels)
    residual = np.empty(count)
    row = np.empty(len(p))
    noise = 0.05
    weight = np.full(count, 1.0 / noise**2)
    normal = levenberg(pixels, weight, frame, p, mean, precision, discs, 12)
    for _ in range(passes):
        for n in range(count):
            residual[n] = abs(pixels[n, 2] - model_row(pixels[n, 0], pixels[n, 1], frame, p, discs, row))
        noise = max(1.4826 * np.median(residual), 1e-4)
        for n in range(count):
            weight[n] = min(1.0, huber * noise / max(residual[n], 1e-12)) / noise**2
        normal = levenberg(pixels, weight, frame, p, mean, precision, discs, 8)
    return p, normal, noise
