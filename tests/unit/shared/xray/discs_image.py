"""Small images of dark discs, for the tests of detection and measurement."""

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.unit.services.imaging.synthetic import shade

Array = NDArray[np.float64]


def image_of_discs(
    centre_px: Array, radius_px: Array, noise: float, seed: int, size_px: int = 400
) -> NDArray[np.float32]:
    """Balls on a background with a slope, an edge and white noise, shown through a power curve; 0 to 1000."""
    y, x = np.mgrid[0:size_px, 0:size_px] / size_px
    light = (0.6 + 0.3 * x - 0.2 * y) * np.where(x + 0.3 * y > 0.9, 0.7, 1.0)
    for (column, row), radius in zip(centre_px, radius_px, strict=True):
        shade(light, float(column), float(row), float(radius))
    light = cv2.GaussianBlur(light, (0, 0), 1.2) + 0.02
    noisy = light**0.65 + np.random.default_rng(seed).normal(0.0, noise, light.shape)
    return np.asarray(1000.0 * np.clip(noisy, 0.0, None), dtype=np.float32)


def grid_of_centres(rng: np.random.Generator, size_px: int = 400, spacing_px: int = 40) -> Array:
    """Places that do not touch, at random fractions of pixels, shape (N, 2)."""
    nodes = np.arange(spacing_px, size_px - spacing_px + 1, spacing_px, dtype=np.float64)
    places = np.stack(np.meshgrid(nodes, nodes), axis=-1).reshape(-1, 2)
    return np.asarray(places + rng.uniform(-6.0, 6.0, places.shape))
