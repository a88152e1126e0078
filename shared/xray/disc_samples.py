"""Compiled: the pixels that a fit of discs uses, and the residuals that it leaves."""

import math

import numpy as np
from numpy.typing import NDArray

from shared.compiled import compiled, compiled_fast

Array = NDArray[np.float64]
FloatImage = NDArray[np.float32]
Mask = NDArray[np.bool_]


@compiled
def gather(pixels: FloatImage, usable: Mask, centre_px: Array, reach_px: Array, avoid: Array) -> Array:
    """Usable pixels within reach of any disc and outside circles to avoid: columns x, y, grey, shape (P, 3)."""
    rows, columns = pixels.shape
    left, right, top, bottom = columns, 0, rows, 0
    for k in range(len(reach_px)):
        left = min(left, math.floor(centre_px[k, 0] - reach_px[k]))
        right = max(right, math.ceil(centre_px[k, 0] + reach_px[k]) + 1)
        top = min(top, math.floor(centre_px[k, 1] - reach_px[k]))
        bottom = max(bottom, math.ceil(centre_px[k, 1] + reach_px[k]) + 1)
    left, right, top, bottom = max(left, 0), min(right, columns), max(top, 0), min(bottom, rows)
    samples = np.empty((max(right - left, 0) * max(bottom - top, 0), 3))
    count = 0
    for y in range(top, bottom):
        for x in range(left, right):
            if (
                usable[y, x]
                and _in_any(x, y, centre_px[:, 0], centre_px[:, 1], reach_px)
                and not _in_any(x, y, avoid[:, 0], avoid[:, 1], avoid[:, 2])
            ):
                samples[count, 0], samples[count, 1], samples[count, 2] = x, y, pixels[y, x]
                count += 1
    return samples[:count]


@compiled
def _in_any(x: float, y: float, centre_x: Array, centre_y: Array, radius: Array) -> bool:
    for k in range(len(radius)):
        dx, dy = x - centre_x[k], y - centre_y[k]
        if dx * dx + dy * dy <= radius[k] * radius[k]:
            return True
    return False


@compiled
def normalise(samples: Array) -> tuple[Array, float, float]:
    """Bring grey values to mean 0 and deviation 1, in place.

    Returns
    -------
    tuple
        Frame of the background's coordinates (centre x, y and scale), the mean of the bright grey values (normalised),
        and the grey values' deviation before.
    """
    grey = samples[:, 2]
    mean, spread = grey.mean(), grey.std()
    if not spread > 0.0:
        spread = 1.0
    for n in range(len(grey)):
        grey[n] = (grey[n] - mean) / spread
    x, y = samples[:, 0], samples[:, 1]
    width, height = x.max() - x.min(), y.max() - y.min()
    frame = np.array(
        [0.5 * (x.max() + x.min()), 0.5 * (y.max() + y.min()), 0.5 * math.sqrt(width * width + height * height)]
    )
    total, count = 0.0, 1e-9
    for n in range(len(grey)):
        if grey[n] > 0.0:
            total += grey[n]
            count += 1.0
    return frame, total / count, spread


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
