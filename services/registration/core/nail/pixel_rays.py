"""The rays that pixels see: through the middle of each, and at places within it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

# 16 places, each with its opposite, that have the mean, the variances and all moments up to the fifth degree of a whole
# pixel: any correlation between column and row would blur slanting edges by too much or too little. The first four
# alone stand for a pixel in which they hardly differ; they have its mean and variances.
_FIRST = np.array([(-0.0148, 0.4080), (0.4080, 0.0148)])
_OTHERS = np.array(
    [(-0.3939, -0.4045), (0.1258, 0.0483), (0.2626, 0.2479), (0.2435, -0.4367), (-0.0392, 0.0954), (0.4464, -0.2698)]
)
SAMPLES_PX = np.concatenate([_FIRST, -_FIRST, _OTHERS, -_OTHERS])
FIRST_SAMPLES = 2 * len(_FIRST)

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


class SteelBeside(NamedTuple):
    """Paths in steel other than the nail, which few pixels have.

    Attributes
    ----------
    row
        Which row of `path_mm` is each pixel's, -1 where there is none, shape (S,).
    path_mm
        At each of the `SAMPLES_PX`, shape (K, samples).
    """

    row: NDArray[np.int64]
    path_mm: NDArray[np.float64]

    @staticmethod
    def of_pixels(count: int, places: NDArray[np.int64], path_mm: NDArray[np.float64]) -> "SteelBeside":
        """Of so many pixels those with a path, looked for at some places; paths there have shape (places, samples)."""
        some = np.any(path_mm > 0.0, axis=1)
        row = np.full(count, -1, dtype=np.int64)
        row[places[some]] = np.arange(np.count_nonzero(some))
        return SteelBeside(row, np.ascontiguousarray(path_mm[some]))

    def of(self, part: slice) -> "SteelBeside":
        """That of some of the pixels."""
        return SteelBeside(self.row[part], self.path_mm)


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
