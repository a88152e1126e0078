"""The robust cost of points and edges, and how outliers are left out.

An M-estimator minimises the sum of rho(r / scale) and is solved by least squares with weights that fall with the
residual r. Cauchy's cost forgets an outlier, as wrong detections must be; that of the nail's pixels (`nail/noise.py`)
only bounds the influence of large noise.
"""

import numpy as np
from numpy.typing import NDArray

from shared.compiled import compiled_inline

# Of a normal error with standard deviation 1: median of its size along one axis, and of its length in the plane.
_MEDIAN_SIZE = {1: 0.674490, 2: float(np.sqrt(2.0 * np.log(2.0)))}


def robust_weight(residual: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    """Cauchy's weights between 0 and 1 by which residuals, or lengths of residual vectors, count in least squares.

    At the scale, in the residuals' unit, the weight has fallen to a half; any shape.
    """
    return np.asarray(1.0 / (1.0 + (residual / scale) ** 2))


@compiled_inline
def cauchy_cost(ratio_squared: float) -> float:
    """Cost of one residual, for compiled loops, from its square over the scale's."""
    return float(np.log1p(ratio_squared))


@compiled_inline
def cauchy_weight(ratio_squared: float) -> float:
    """As `robust_weight`, for compiled loops."""
    return 1.0 / (1.0 + ratio_squared)


def robust_spread(residual: NDArray[np.float64], axes: int = 1) -> float:
    """Standard deviation per axis by the median of residuals, or of lengths in the plane where `axes` is 2, shape (N,).

    Half of them may be outliers.
    """
    return float(np.median(np.abs(residual))) / _MEDIAN_SIZE[axes]


def inliers(
    residual: NDArray[np.float64], used: NDArray[np.bool_], limit: float, least_spread: float, axes: int = 1
) -> NDArray[np.bool_]:
    """Which residuals, shape (N,), are smaller than `limit` robust standard deviations of those in use.

    One round of trimming: fit to those in use, call this, and repeat until the same ones are in use. The spread is at
    least `least_spread`, in the residuals' unit.
    """
    spread = max(least_spread, robust_spread(residual[used], axes))
    return np.asarray(np.abs(residual) < limit * spread)
