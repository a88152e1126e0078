"""Gaussian blur of small images, compiled."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.compiled import compiled

_KERNEL_REACH = 4.0


def blurred_image(image: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Gaussian blur with edge values repeated."""
    reach = max(1, int(np.ceil(_KERNEL_REACH * sigma)))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(sigma, 1e-3)) ** 2)
    out = np.empty_like(image)
    _separable_blur(image, kernel / kernel.sum(), np.empty_like(image), out)
    return out


@compiled
def _separable_blur(
    image: NDArray[np.float64],
    kernel: NDArray[np.float64],
    between: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    rows, columns = image.shape
    reach = kernel.shape[0] // 2
    for i in range(rows):
        for j in range(columns):
            total = kernel[reach] * image[i, j]
            for k in range(1, reach + 1):
                total += kernel[reach + k] * (image[i, max(j - k, 0)] + image[i, min(j + k, columns - 1)])
            between[i, j] = total
    for i in range(rows):
        for j in range(columns):
            out[i, j] = kernel[reach] * between[i, j]
        for k in range(1, reach + 1):
            above, below = max(i - k, 0), min(i + k, rows - 1)
            for j in range(columns):
                out[i, j] += kernel[reach + k] * (between[above, j] + between[below, j])
