"""How accurately one image locates the guide, and how accurately the robot reports its pose. Pure.

All covariances are of a small rotation (rad) and translation (mm) in the guide's own frame, shape (6, 6).
"""

import numpy as np
from numpy.typing import NDArray

from shared.geometry.hexapod_accuracy import POSE_SD_DEG, POSE_SD_MM

# One image, in the directions of the beam: rotation about two axes across it and about its own, translation likewise.
# `distalock bench guide_calibration` compares with what rendered images give.
IMAGE_SD = np.array([*np.radians([0.025, 0.025, 0.006]), 0.006, 0.006, 0.1])
# The fit of the balls estimates a tilt error of 0.015 degrees: the rest of 0.025.
_TILT_BEYOND_THE_FIT_RAD = float(np.radians(0.02))


def robot_covariance() -> NDArray[np.float64]:
    """What the hexapod's own accuracy adds to a view."""
    return np.diag(np.repeat([np.radians(POSE_SD_DEG) ** 2, POSE_SD_MM**2], 3))


def image_covariance(beam_from_guide: NDArray[np.float64]) -> NDArray[np.float64]:
    """What one usual image leaves open.

    Parameters
    ----------
    beam_from_guide
        Rotations into a frame with its z along the beam, shape (..., 3, 3).
    """
    both = np.zeros((*beam_from_guide.shape[:-2], 6, 6))
    both[..., :3, :3] = both[..., 3:, 3:] = beam_from_guide
    return np.asarray(np.swapaxes(both, -1, -2) @ (IMAGE_SD[:, None] ** 2 * both))


def tilt_beyond_the_fit(beam_from_guide: NDArray[np.float64]) -> NDArray[np.float64]:
    """What to add to the covariance that a fit of the guide's balls gives itself, rotation of shape (3, 3)."""
    added = np.zeros((6, 6))
    across = beam_from_guide[:2]
    added[:3, :3] = _TILT_BEYOND_THE_FIT_RAD**2 * across.T @ across
    return added
