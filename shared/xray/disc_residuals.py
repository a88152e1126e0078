"""Compiled: what a fit of discs leaves of the pixels it looked at."""

import math

import numpy as np
from numpy.typing import NDArray

from shared.compiled import compiled, compiled_fast

Array = NDArray[np.float64]


@compiled
def neighbours(samples: Array, residual: Array, limit: float) -> tuple[float, float]:
    """Correlation of residuals of pixels next to each other in a row, and their mean squared difference.

    Residuals beyond a limit count as the limit.
    """
    common, square, pairs = 0.0, 0.0, 0
    for n in range(1, len(residual)):
        if samples[n, 1] == samples[n - 1, 1] and samples[n, 0] == samples[n - 1, 0] + 1.0:
            left = min(max(residual[n - 1], -limit), limit)
            right = min(max(residual[n], -limit), limit)
            common += left * right
            square += 0.5 * (left * left + right * right)
            pairs += 1
    if pairs == 0 or square <= 0.0:
        return 0.0, 0.0
    return common / square, 2.0 * (square - common) / pairs


@compiled_fast
def darkest_spot(residual: Array, radius: float) -> tuple[int, float]:
    """Where a disc is darker than the model says, by most.

    Parameters
    ----------
    residual
        Columns x, y and residual of a fit's pixels, row by row, shape (P, 3).
    radius
        Of the disc.

    Returns
    -------
    tuple
        Index of the sample at the middle of the disc, and the sum of its residuals over the square root of how many
        they are, negated.
    """
    best, where, first = 0.0, 0, 0
    for centre in range(len(residual)):
        x, y = residual[centre, 0], residual[centre, 1]
        while residual[first, 1] < y - radius:
            first += 1
        total, count = 0.0, 0
        for n in range(first, len(residual)):
            dx, dy = residual[n, 0] - x, residual[n, 1] - y
            if dy > radius:
                break
            if dx * dx + dy * dy <= radius * radius:
                total -= residual[n, 2]
                count += 1
        score = total / math.sqrt(count)
        if score > best:
            best, where = score, centre
    return where, best
