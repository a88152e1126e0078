"""The rays that pixels see: through the middle of each, and at places within it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

# A lattice of 16 places with a row and a column of its own for each. The first four alone stand for pixels that no edge
# crosses: they have a quarter of the rows and columns each, and the pixel's middle as their mean.
_FIRST = [1, 14, 6, 9]
_ORDER = np.array([*_FIRST, *(k for k in range(16) if k not in _FIRST)])
SAMPLES_PX = (np.stack([_ORDER, (7 * _ORDER + 3) % 16], axis=1) + 0.5) / 16.0 - 0.5

# Fewer are followed sooner than handed to another core.
LEAST_RAYS_TO_SHARE = 1000


class PixelRays(NamedTuple):
    """Directions (x, y) at z = 1 in the camera's frame, shape (S, 2) each.

    Attributes
    ----------
    slopes
        Through the middle of each pixel.
    right, down
        Their change from column to column and from row to row.
    """

    slopes: NDArray[np.float64]
    right: NDArray[np.float64]
    down: NDArray[np.float64]


def pixel_rays(slopes: NDArray[np.float64]) -> PixelRays:
    """Rays of all pixels, row by row, of a rectangle whose directions have shape (rows, columns, 2)."""
    # differences between neighbours are good enough: distortion is smooth
    down, right = np.gradient(slopes, axis=(0, 1))
    return PixelRays(*(np.ascontiguousarray(a.reshape(-1, 2)) for a in (slopes, right, down)))


def rays_of(rays: PixelRays, part: slice | NDArray[np.int64]) -> PixelRays:
    """Those of some of the pixels."""
    return PixelRays(*(of_all[part] for of_all in rays))


def sample_directions(rays: PixelRays, places_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions at places within each pixel, shape (K, 2); pixel by pixel, shape (S * K, 2)."""
    samples = rays.slopes[:, None] + places_px[:, :1] * rays.right[:, None] + places_px[:, 1:] * rays.down[:, None]
    return np.ascontiguousarray(samples.reshape(-1, 2))
