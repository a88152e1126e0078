"""Two words on one nail: where guide and key put it, and where this frame's own pixels do; weighed by their errors.

The first is steady but as wrong as its key, the second is new but noisy, and at small tilts, where a bore shows hardly
any sign, it wanders. Weights take the two as independent. The covariance does not: bone texture and display mislead key
and frame in part alike.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shared.geometry.frames import Camera, Nail
from shared.geometry.transform import Transform

_SHARED = 0.5


def weighed(
    predicted: Transform[Camera, Nail],
    predicted_covariance: NDArray[np.float64],
    seen: Transform[Camera, Nail],
    seen_covariance: NDArray[np.float64],
) -> tuple[Transform[Camera, Nail], NDArray[np.float64]]:
    """The weighted mean of two poses, and its covariance under partly shared errors.

    Covariances have shape (6, 6), of a small motion in the nail's own frame, as in `NailEstimate`.
    """
    apart = predicted.inverse() @ seen
    motion = np.concatenate([apart.rotation_vector_rad, apart.translation_mm])
    gain = np.linalg.solve(predicted_covariance + seen_covariance, predicted_covariance).T
    rest = np.eye(6) - gain
    step = gain @ motion
    moved: Transform[Nail, Nail] = Transform.from_rotation_translation(
        Rotation.from_rotvec(step[:3]).as_matrix(), step[3:]
    )
    both = _SHARED * np.linalg.cholesky(predicted_covariance) @ np.linalg.cholesky(seen_covariance).T
    crossed = rest @ both @ gain.T
    covariance = rest @ predicted_covariance @ rest.T + gain @ seen_covariance @ gain.T + crossed + crossed.T
    return predicted @ moved, covariance
