"""What passes along one ray as a function of its path, and the causes by which that changes."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.compiled import compiled

# Columns of the derivatives: small motion of the nail in its own frame (rotation vector, translation), radii, material.
MOTION_SIZE = 6
HOLE_RADIUS, NAIL_RADIUS, CHAMFER, LOG_ATTENUATION, HARDENING = range(MOTION_SIZE, MOTION_SIZE + 5)
DERIVATIVES = MOTION_SIZE + 5

# The hardest X-rays of a tube at 60-80 kV are attenuated by this share of the mean: so much hardening leaves.
_HARDEST = 0.4
# Below, the law is the exponential one, and its derivative the first term of a series.
_NO_HARDENING = 1e-3

Material = tuple[float, float]
Shade = tuple[float, float, float]


@compiled
def shade_behind(path_mm: float, material: Material) -> Shade:
    """exp(-f * d) * (1 + h * (1 - f) * d)^(-1 / h) behind a path of depth d; its derivatives by log d and by h.

    That is what passes of a beam whose attenuations are f times their mean (d counts the mean) and above that
    distributed like a gamma variable of relative variance h, the hardening. The first tenths of a millimetre meet the
    mean, and the rest what came through.
    """
    depth, hardening = material[0] * path_mm, material[1]
    if depth <= 0.0:
        return 1.0, 0.0, 0.0
    soft = (1.0 - _HARDEST) * depth
    if hardening < _NO_HARDENING:
        passed = np.exp(-depth)
        return passed, -depth * passed, 0.5 * soft * soft * passed
    # log1p would be exact for a vanishing path too, where nothing depends on it, and takes about twice as long
    logarithm, left = np.log(1.0 + hardening * soft) / hardening, soft / (1.0 + hardening * soft)
    passed = np.exp(-_HARDEST * depth - logarithm)
    return passed, -(_HARDEST * depth + left) * passed, (logarithm - left) / hardening * passed


@compiled
def mean_shade(low: Shade, middle: Shade, high: Shade) -> Shade:
    """Mean over a short way (Simpson's rule)."""
    return (
        (low[0] + 4.0 * middle[0] + high[0]) / 6.0,
        (low[1] + 4.0 * middle[1] + high[1]) / 6.0,
        (low[2] + 4.0 * middle[2] + high[2]) / 6.0,
    )


@compiled
def add_motion(
    x: float, y: float, z: float, gx: float, gy: float, gz: float, share: float, slope: NDArray[np.float32]
) -> None:
    """Add what the motion of a surface at (x, y, z) along its normal g contributes."""
    slope[0] += share * (y * gz - z * gy)
    slope[1] += share * (z * gx - x * gz)
    slope[2] += share * (x * gy - y * gx)
    slope[3] += share * gx
    slope[4] += share * gy
    slope[5] += share * gz
