"""How far the fitted pose may be off, in a form that others can use: a small motion of the nail in its own frame."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.pose import POSE_SIZE, motion_by_parameters
from services.registration.core.nail.scene import NailScene
from services.registration.core.nail.solver import Solution

# What nobody models (the display's true curve, the blur's true shape, chamfers) adds about as much again as two
# thirds of the noise: standard deviations are widened by this factor.
_UNMODELLED = 1.2


def pose_covariance(scene: NailScene, solution: Solution) -> NDArray[np.float64]:
    """Covariance of a small motion of the nail in its own frame, shape (6, 6): rotation vector (rad), translation (mm).

    The true pose is `camera_from_nail @ motion` with `motion` this small motion. The solution's normal matrix must be
    that of a cost which counts independent samples (`stages.reweighted`), with background, floor and nuisances
    eliminated or among its rows.
    """
    covariance = np.linalg.inv(solution.normal_matrix)[:POSE_SIZE, :POSE_SIZE] * _UNMODELLED**2
    jacobian = motion_by_parameters(solution.parameters[:POSE_SIZE], scene.camera, scene.anchors)
    return np.asarray(jacobian @ covariance @ jacobian.T)
