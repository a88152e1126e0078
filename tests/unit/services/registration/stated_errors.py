"""Errors of a pose as a test states them."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import PoseErrors


def errors_without_shape(image_covariance: NDArray[np.float64], model_loadings: NDArray[np.float64]) -> PoseErrors:
    """Errors of which the nail's shape has no part, shapes (6, 6) and (6, M)."""
    return PoseErrors(np.zeros(0), image_covariance, np.zeros((6, 0)), model_loadings)
