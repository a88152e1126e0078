"""Compiled: the pixels that a fit of discs looks at."""

import math

import numpy as np
from numpy.typing import NDArray

from shared.compiled import compiled

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
