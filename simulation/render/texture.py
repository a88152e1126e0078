"""Trabecular bone as a periodic random volume: fine struts along the load, and coarse variation of density."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

VOXEL_MM = 0.8
_SIZE = 96
_FINE_MM = (1.6, 0.7, 0.7)
_COARSE_MM = (7.0, 5.0, 5.0)
_COARSE_SHARE = 0.6


def _smooth_noise(generator: np.random.Generator, correlation_mm: tuple[float, float, float]) -> NDArray[np.float64]:
    """Periodic Gaussian noise of unit variance, smoothed by a Gaussian of the given widths along x, y, z."""
    white = np.fft.rfftn(generator.standard_normal((_SIZE, _SIZE, _SIZE)))
    kx, kz = np.fft.fftfreq(_SIZE), np.fft.rfftfreq(_SIZE)
    w = [2 * np.pi * np.pi * (c / VOXEL_MM) ** 2 for c in correlation_mm]
    low = np.exp(-(w[0] * kx[:, None, None] ** 2 + w[1] * kx[None, :, None] ** 2 + w[2] * kz[None, None, :] ** 2))
    noise = np.fft.irfftn(white * low, s=(_SIZE, _SIZE, _SIZE), axes=(0, 1, 2))
    return np.asarray((noise - noise.mean()) / noise.std())


@lru_cache(maxsize=4)
def trabecular_volume(seed: int) -> NDArray[np.float32]:
    """Relative deviation of the bone's density, shape (96, 96, 96), mean 0, variance 1, `VOXEL_MM` a voxel."""
    generator = np.random.default_rng([seed, 0x7EA])
    fine, coarse = _smooth_noise(generator, _FINE_MM), _smooth_noise(generator, _COARSE_MM)
    mixed = fine + _COARSE_SHARE * coarse
    volume = (mixed / mixed.std()).astype(np.float32)
    volume.setflags(write=False)
    return np.asarray(volume)
