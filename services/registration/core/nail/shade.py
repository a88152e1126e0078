"""What passes along one ray as a function of its path, and the causes by which that changes."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.compiled import compiled

# Columns of the derivatives: small motion of the nail in its own frame (rotation vector, translation), radii, material.
MOTION_SIZE = 6
HOLE_RADIUS, NAIL_RADIUS, CHAMFER, LOG_ATTENUATION, POWER = range(MOTION_SIZE, MOTION_SIZE + 5)
DERIVATIVES = MOTION_SIZE + 5

_OPAQUE = 200.0

Material = tuple[float, float]
Shade = tuple[float, float, float]


@compiled
def shade_behind(path_mm: float, material: Material) -> Shade:
    """exp(-depth^power) behind a path, and its derivatives by the logarithm of the depth and by the power."""
    depth = material[0] * path_mm
    if depth <= 0.0:
        return 1.0, 0.0, 0.0
    if depth > _OPAQUE:
        return 0.0, 0.0, 0.0
    logarithm = np.log(depth)
    shade = np.exp(material[1] * logarithm)
    passed = np.exp(-shade)
    return passed, -material[1] * shade * passed, -shade * logarithm * passed


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
    x: float, y: float, z: float, gx: float, gy: float, gz: float, share: float, slope: NDArray[np.float64]
) -> None:
    """Add what the motion of a surface at (x, y, z) along its normal g contributes."""
    slope[0] += share * (y * gz - z * gy)
    slope[1] += share * (z * gx - x * gz)
    slope[2] += share * (x * gy - y * gx)
    slope[3] += share * gx
    slope[4] += share * gy
    slope[5] += share * gz
