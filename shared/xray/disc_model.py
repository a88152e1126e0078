"""Grey values of blurred discs and their derivatives, compiled.

The parameters of a group of K discs are, in this order: background (6: constant, slopes, curvatures), then contrast,
x, y and radius of each disc, then the depth of overlaps and the blur. `discs.py` says what they mean.

A shadow is not taken off the background but stands in its way: under a steel ball hardly anything of the background's
slope is seen. A model that subtracts the same depth everywhere draws a ball beside a bone's edge towards the edge.
"""

import math

import numpy as np
from numpy.typing import NDArray

from shared.compiled import compiled_fast

Array = NDArray[np.float64]

# Coefficients of a quadratic in two variables.
BACKGROUND_TERMS = 6
_ROOT_2 = math.sqrt(2.0)
_ROOT_2PI = math.sqrt(2.0 * math.pi)
# Abramowitz and Stegun, Handbook of Mathematical Functions, 7.1.26: the complementary error function to 1.5e-7.
_P = 0.3275911
_A1, _A2, _A3, _A4, _A5 = 0.254829592, -0.284496736, 1.421413741, -1.453152027, 1.061405429
# Half of z^2 beyond which a bell falls no further (4e-18).
_FLAT = 40.0


@compiled_fast
def bell_of(z: float) -> float:
    """exp(-z^2/2) to 1e-12: the exponential of a 256th of it, eight times squared, which needs no library call."""
    x = min(0.5 * z * z, _FLAT) / -256.0
    bell = 1.0 + x * (1.0 + x / 2.0 * (1.0 + x / 3.0 * (1.0 + x / 4.0 * (1.0 + x / 5.0))))
    for _ in range(8):
        bell *= bell
    return bell


@compiled_fast
def edge(z: float, bell: float) -> float:
    """Part of the light that a blurred edge takes, `z` blurs outside it; `bell` is exp(-z^2/2)."""
    t = 1.0 / (1.0 + _P * abs(z) / _ROOT_2)
    tail = 0.5 * bell * t * (_A1 + t * (_A2 + t * (_A3 + t * (_A4 + t * _A5))))
    return tail if z > 0.0 else 1.0 - tail


@compiled_fast
def model_rows(samples: Array, frame: Array, p: Array, discs: int, opacity: float, rows: Array, grey: Array) -> None:
    """Grey value of the model at each pixel, shape (N,), and its derivatives by the parameters, shape (parameters, N).

    `opacity` is the share of the background's variation that a disc hides. Rows of derivatives lie together in memory,
    for speed.
    """
    b = BACKGROUND_TERMS
    for k in range(discs):
        _coverages(samples, p, discs, k, rows)
    slope = np.empty(len(samples))
    _background(samples, frame, p, discs, opacity, rows, grey, slope)
    rows[-2, :], rows[-1, :] = 0.0, 0.0
    for k in range(discs):
        _slopes(samples, p, discs, k, opacity, slope, rows)
    for k in range(discs):
        for n in range(len(samples)):
            grey[n] -= p[b + k] * rows[b + k, n]
    _overlaps(p, discs, rows, grey)


@compiled_fast
def _background(
    samples: Array, frame: Array, p: Array, discs: int, opacity: float, rows: Array, grey: Array, slope: Array
) -> None:
    """Background past the discs, its derivatives, and how it varies (`slope`); coverages are in `rows`."""
    for n in range(len(samples)):
        u, v = (samples[n, 0] - frame[0]) / frame[2], (samples[n, 1] - frame[1]) / frame[2]
        slope[n] = p[1] * u + p[2] * v + p[3] * u * u + p[4] * u * v + p[5] * v * v
        past = 1.0
        for k in range(discs):
            past *= 1.0 - rows[BACKGROUND_TERMS + k, n]
        seen = 1.0 - opacity * (1.0 - past)
        rows[0, n], rows[1, n], rows[2, n] = 1.0, u * seen, v * seen
        rows[3, n], rows[4, n], rows[5, n] = u * u * seen, u * v * seen, v * v * seen
        grey[n] = p[0] + slope[n] * seen


@compiled_fast
def _coverages(samples: Array, p: Array, discs: int, k: int, rows: Array) -> None:
    """How much of each pixel disc `k` covers, in its row.

    Its rows for y and radius keep the distance from its centre and the bell of its edge for `_slopes`.
    """
    first, blur = BACKGROUND_TERMS + k, p[-1]
    x, y, radius = p[first + discs], p[first + 2 * discs], p[first + 3 * discs]
    covered, distance, bell = rows[first], rows[first + 2 * discs], rows[first + 3 * discs]
    # three short loops, which the compiler turns into vector instructions, where one long one stays as it is
    for n in range(len(samples)):
        dx, dy = samples[n, 0] - x, samples[n, 1] - y
        distance[n] = math.sqrt(dx * dx + dy * dy) + 1e-9
    for n in range(len(samples)):
        bell[n] = bell_of((distance[n] - radius) / blur)
    for n in range(len(samples)):
        covered[n] = edge((distance[n] - radius) / blur, bell[n])


@compiled_fast
def _slopes(samples: Array, p: Array, discs: int, k: int, opacity: float, slope: Array, rows: Array) -> None:
    """Derivatives by place and radius of disc `k`, and its share of that by the blur.

    Rows are as `_coverages` left them; `slope` is by how much the background differs from its constant, shape (N,).
    """
    b = BACKGROUND_TERMS
    x, y, radius, overlap, blur = p[b + discs + k], p[b + 2 * discs + k], p[b + 3 * discs + k], p[-2], p[-1]
    for n in range(len(samples)):
        dx, dy = samples[n, 0] - x, samples[n, 1] - y
        distance, bell = rows[b + 2 * discs + k, n], rows[b + 3 * discs + k, n]
        contrast, past_others = p[b + k], 1.0
        for j in range(discs):
            if j != k:
                past_others *= 1.0 - rows[b + j, n]
                contrast -= overlap * max(min(p[b + k], p[b + j]), 0.0) * rows[b + j, n]
        contrast += opacity * slope[n] * past_others
        along = -contrast * bell / (_ROOT_2PI * blur)
        rows[b + discs + k, n] = along * dx / distance
        rows[b + 2 * discs + k, n] = along * dy / distance
        rows[b + 3 * discs + k, n] = along
        rows[-1, n] += along * (distance - radius) / blur


@compiled_fast
def _overlaps(p: Array, discs: int, rows: Array, grey: Array) -> None:
    """What overlaps take back of the summed shadows; turns the coverages in `rows` into derivatives by contrast."""
    b = BACKGROUND_TERMS
    overlap = p[-2]
    if discs == 1:
        for n in range(len(grey)):
            rows[b, n] = -rows[b, n]
        return
    covered = np.empty(discs)
    for n in range(len(grey)):
        for k in range(discs):
            covered[k] = rows[b + k, n]
            rows[b + k, n] = -covered[k]
        common = 0.0
        for k in range(discs):
            for j in range(k + 1, discs):
                both = covered[k] * covered[j]
                # Of two shadows the darker one stays: with overlap 1 the fainter one adds nothing.
                fainter = k if p[b + k] < p[b + j] else j
                if p[b + fainter] > 0.0:
                    common += p[b + fainter] * both
                    rows[b + fainter, n] += overlap * both
        rows[-2, n] = common
        grey[n] += overlap * common
