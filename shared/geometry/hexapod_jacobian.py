"""How the legs change when the platform moves a little, and how far it is from a singularity."""

import numpy as np
from numpy.typing import NDArray

from shared.geometry.hexapod import HexapodPart, leg_vectors_mm, rotation_of


def leg_jacobians(
    hexapod: HexapodPart, poses: NDArray[np.float64], pivot_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Derivatives of the leg lengths (mm) by a displacement of the pivot (mm) and a rotation about it (rad).

    Row i is (d, (R a) x d) with the leg's direction d and its arm a from the pivot; displacement and rotation vector
    are in `RobotBase`.

    Parameters
    ----------
    poses
        X Y Z (mm) and U V W (degrees), shape (..., 6).
    pivot_mm
        Centre of rotation in the top's frame, shape (3,).

    Returns
    -------
    NDArray
        Shape (..., 6, 6): a leg a row.
    """
    legs = leg_vectors_mm(hexapod, poses, pivot_mm)
    directions = legs / np.linalg.norm(legs, axis=-1, keepdims=True)
    arms = (hexapod.top_joints_mm - pivot_mm) @ np.swapaxes(rotation_of(poses[..., 3:]), -1, -2)
    return np.concatenate([directions, np.cross(arms, directions)], axis=-1)


def singularity_margins(
    hexapod: HexapodPart, poses: NDArray[np.float64], pivot_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How much the legs change at least when the platform moves by one millimetre; 0 in a singular pose.

    The smallest singular value of the Jacobian about the middle of the top joints, with rotations counted as the way
    (mm) of a joint at the root mean square radius, so that the value depends neither on the pivot nor on the unit of
    angles. A leg's error, or its give, is magnified by at most the inverse of it.

    Parameters
    ----------
    poses
        X Y Z (mm) and U V W (degrees) about the pivot, shape (..., 6).
    pivot_mm
        Centre of rotation in the top's frame, shape (3,).

    Returns
    -------
    NDArray
        Shape (...).
    """
    middle_mm = hexapod.top_joints_mm.mean(axis=0)
    radius_mm = np.sqrt(np.sum((hexapod.top_joints_mm - middle_mm) ** 2, axis=1).mean())
    about_pivot = leg_jacobians(hexapod, poses, pivot_mm)
    to_pivot = rotation_of(poses[..., 3:]) @ (pivot_mm - middle_mm)
    directions = about_pivot[..., :3]
    moments = about_pivot[..., 3:] + np.cross(to_pivot[..., None, :], directions)
    scaled = np.concatenate([directions, moments / radius_mm], axis=-1)
    return np.asarray(np.linalg.svd(scaled, compute_uv=False)[..., -1])
