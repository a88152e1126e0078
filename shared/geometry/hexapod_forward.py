"""From leg lengths back to the pose of the platform: forward kinematics by Newton's method."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shared.geometry.frames import RobotBase, RobotTop
from shared.geometry.hexapod import ZERO_POSE, HexapodPart, PlatformPose, base_from_top, pose_values
from shared.geometry.transform import Transform

# Newton's method takes 5 or 6 from anywhere in the workspace; the goal is some hundred roundings of a leg's length.
MAXIMUM_ITERATIONS = 30
CONVERGED_MM = 1e-11


def poses_from_leg_lengths(
    hexapod: HexapodPart,
    lengths_mm: NDArray[np.float64],
    pivot_mm: NDArray[np.float64],
    near: PlatformPose = ZERO_POSE,
) -> NDArray[np.float64]:
    """Poses of the platform for measured leg lengths.

    Six lengths allow up to forty poses. Newton's method finds the one that is reached from `near` without passing a
    singular pose: within the limits of a leg's travel and of the joints' cones, the one the robot is in.

    Parameters
    ----------
    lengths_mm
        Shape (N, 6), joint centre to joint centre.
    pivot_mm
        Centre of rotation in the top's frame, shape (3,).
    near
        Where to start.

    Returns
    -------
    NDArray
        X Y Z (mm) and U V W (degrees), shape (N, 6).

    Raises
    ------
    ValueError
        When no pose near `near` has these leg lengths.
    """
    start: Transform[RobotBase, RobotTop] = base_from_top(hexapod, near, pivot_mm)
    count = len(lengths_mm)
    rotations = np.broadcast_to(start.rotation, (count, 3, 3)).copy()
    translations = np.broadcast_to(start.translation_mm, (count, 3)).copy()
    for _ in range(MAXIMUM_ITERATIONS):
        residuals, jacobians = _residuals_and_jacobians(hexapod, rotations, translations, lengths_mm)
        if float(np.abs(residuals).max(initial=0.0)) < CONVERGED_MM:
            break
        try:
            step = np.linalg.solve(jacobians, residuals[..., None])[..., 0]
        except np.linalg.LinAlgError:
            _refuse_unless_converged(residuals, lengths_mm)
            break
        translations -= step[:, :3]
        rotations = Rotation.from_rotvec(-step[:, 3:]).as_matrix() @ rotations
    else:
        _refuse_unless_converged(residuals, lengths_mm)
    return pose_values(hexapod, rotations, translations, pivot_mm)


def _residuals_and_jacobians(
    hexapod: HexapodPart,
    rotations: NDArray[np.float64],
    translations: NDArray[np.float64],
    lengths_mm: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Length errors in mm, shape (N, 6), and their derivatives by translation (mm) and rotation (rad), (N, 6, 6)."""
    arms = hexapod.top_joints_mm @ np.swapaxes(rotations, -1, -2)
    legs = arms + translations[:, None, :] - hexapod.base_joints_mm
    lengths = np.linalg.norm(legs, axis=-1)
    directions = legs / lengths[..., None]
    jacobians = np.concatenate([directions, np.cross(arms, directions)], axis=-1)
    return lengths - lengths_mm, jacobians


def _refuse_unless_converged(residuals: NDArray[np.float64], lengths_mm: NDArray[np.float64]) -> None:
    # Rounding alone can hold a residual slightly above the goal; a thousandth of a micrometre is still a solution.
    worst = int(np.argmax(np.abs(residuals).max(axis=-1)))
    remaining = float(np.abs(residuals[worst]).max())
    if not remaining < 1e-6:
        raise ValueError(
            f"no pose has the leg lengths {np.round(lengths_mm[worst], 3).tolist()} mm: the nearest found leaves a leg "
            f"off by {remaining:.3g} mm (limit 1e-6); check the leg encoders"
        )
