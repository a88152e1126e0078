"""Gaussian blur of small images."""

from functools import lru_cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

_KERNEL_REACH = 4.0

Real = TypeVar("Real", np.float32, np.float64)


def blurred_image(image: NDArray[Real], sigma: float) -> NDArray[Real]:
    """Gaussian blur with edge values repeated, in the image's own precision."""
    kernel = _kernel(sigma)
    blurred = cv2.sepFilter2D(image, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, dtype=image.dtype)


# a set of derivatives blurs dozens of pictures by the same few widths
@lru_cache(maxsize=64)
def _kernel(sigma: float) -> NDArray[np.float64]:
    # Not GaussianBlur: its kernel's length is odd in steps, so that the result would jump while a fit moves sigma.
    reach = max(1, int(np.ceil(_KERNEL_REACH * sigma)))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(sigma, 1e-3)) ** 2)
    kernel /= kernel.sum()
    kernel.flags.writeable = False
    return np.asarray(kernel)
