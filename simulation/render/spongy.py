"""How much mineral a ray meets in spongy bone, from the trabecular texture."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulation.render.femur import flare

Floats = NDArray[np.float64]
_STEP_MM = 2.5


@njit(cache=True, error_model="numpy")
def _texture_at(volume: NDArray[np.float32], x: float, y: float, z: float) -> float:
    """Trilinear look-up in a periodic volume."""
    n = volume.shape[0]
    fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
    i, j, k = int(fx) % n, int(fy) % n, int(fz) % n
    i1, j1, k1 = (i + 1) % n, (j + 1) % n, (k + 1) % n
    x, y, z = x - fx, y - fy, z - fz
    a = volume[i, j, k] * (1 - z) + volume[i, j, k1] * z
    b = volume[i, j1, k] * (1 - z) + volume[i, j1, k1] * z
    c = volume[i1, j, k] * (1 - z) + volume[i1, j, k1] * z
    e = volume[i1, j1, k] * (1 - z) + volume[i1, j1, k1] * z
    return float((a * (1 - y) + b * y) * (1 - x) + (c * (1 - y) + e * y) * x)


@njit(cache=True, error_model="numpy")
def mineral_share(
    spongy: Floats, volume: NDArray[np.float32], voxel_mm: float, ray: Floats, near: float, far: float
) -> float:
    """Mean share of mineral along a stretch of one ray.

    Parameters
    ----------
    spongy
        `[share in the metaphysis, share in the shaft, flare from x, flare to x, contrast]`.
    volume
        Relative deviation of the density, shape (n, n, n), periodic.
    ray
        Origin and direction in the bone's frame, shape (2, 3).
    near, far
        The stretch, along the ray.
    """
    if near >= far:
        return 0.0
    d = ray[1]
    length = (far - near) * np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    steps = max(1, int(length / _STEP_MM))
    total = 0.0
    for i in range(steps):
        t = near + (i + 0.5) / steps * (far - near)
        x, y, z = ray[0, 0] + t * d[0], ray[0, 1] + t * d[1], ray[0, 2] + t * d[2]
        share = spongy[1] + flare(x, spongy[2], spongy[3]) * (spongy[0] - spongy[1])
        total += share * max(0.0, 1.0 + spongy[4] * _texture_at(volume, x / voxel_mm, y / voxel_mm, z / voxel_mm))
    return float(total / steps)
