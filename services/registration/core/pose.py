"""Pose of a rigid body from where its points appear in the image: robust least squares."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from services.registration.core.pose_kernel import Seen, jacobian_row, refined
from shared.geometry.camera import PinholeCamera

_ITERATIONS = 30
CAUCHY_SIGMAS = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class RigidPose:
    """A rotation and a translation: maps body coordinates to camera coordinates.

    Attributes
    ----------
    rotation
        Shape (3, 3).
    translation_mm
        Shape (3,).
    """

    rotation: NDArray[np.float64]
    translation_mm: NDArray[np.float64]

    def points(self, body_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Camera coordinates, shape (..., 3), of body points, shape (..., 3), in mm."""
        return np.asarray(body_mm @ self.rotation.T + self.translation_mm)

    def moved(self, step: NDArray[np.float64]) -> "RigidPose":
        """The pose after a small motion in the body's own frame: rotation vector (rad) and translation (mm), (6,)."""
        turned = self.rotation @ Rotation.from_rotvec(step[:3]).as_matrix()
        return RigidPose(turned, self.translation_mm + self.rotation @ step[3:])


@dataclass(frozen=True, slots=True, eq=False)
class Correspondences:
    """Points of a body and where they were seen.

    Attributes
    ----------
    body_mm
        Shape (N, 3).
    ideal_px
        Undistorted pixels, shape (N, 2).
    standard_deviation_px
        Per axis, shape (N,).
    """

    body_mm: NDArray[np.float64]
    ideal_px: NDArray[np.float64]
    standard_deviation_px: NDArray[np.float64]

    def chosen(self, mask: NDArray[np.bool_]) -> "Correspondences":
        """Those where `mask`, shape (N,), is true."""
        return Correspondences(self.body_mm[mask], self.ideal_px[mask], self.standard_deviation_px[mask])

    def __len__(self) -> int:
        return len(self.body_mm)


def residuals_px(camera: PinholeCamera, pose: RigidPose, seen: Correspondences) -> NDArray[np.float64]:
    """Seen minus projected, ideal pixels, shape (N, 2)."""
    return seen.ideal_px - camera.project(pose.points(seen.body_mm))


def projection_jacobian(camera: PinholeCamera, pose: RigidPose, body_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """How projections move with the pose (see `RigidPose.moved`), shape (N, 2, 6), px per rad and px per mm."""
    jacobian = np.empty((len(body_mm), 2, 6))
    for point_mm, at_camera_mm, rows in zip(body_mm, pose.points(body_mm), jacobian, strict=True):
        for axis in range(2):
            jacobian_row(camera.intrinsic_matrix_px, pose.rotation, at_camera_mm, point_mm, axis, rows[axis])
    return jacobian


def refine_pose(
    camera: PinholeCamera, start: RigidPose, seen: Correspondences, most_steps: int = _ITERATIONS
) -> RigidPose:
    """Move a pose to where it explains the seen points best, with Cauchy weights against outliers.

    Levenberg-Marquardt on at least three points; the start must be near enough to project all points in front of the
    focal spot.
    """
    rotation, translation_mm = refined(
        camera.intrinsic_matrix_px,
        (np.ascontiguousarray(start.rotation), np.ascontiguousarray(start.translation_mm)),
        Seen(
            np.ascontiguousarray(seen.body_mm),
            np.ascontiguousarray(seen.ideal_px),
            CAUCHY_SIGMAS * seen.standard_deviation_px,
        ),
        most_steps,
    )
    return RigidPose(rotation, translation_mm)


def _cauchy_weights(residual: NDArray[np.float64], seen: Correspondences) -> NDArray[np.float64]:
    ratio = np.sum(residual**2, axis=1) / (CAUCHY_SIGMAS * seen.standard_deviation_px) ** 2
    return np.asarray(1.0 / ((1.0 + ratio) * seen.standard_deviation_px**2))


def down_weighted(camera: PinholeCamera, pose: RigidPose, seen: Correspondences) -> Correspondences:
    """The same points with the standard deviations that their weights in `refine_pose` amount to."""
    weight = _cauchy_weights(residuals_px(camera, pose, seen), seen)
    return Correspondences(seen.body_mm, seen.ideal_px, 1.0 / np.sqrt(weight))


def pose_covariance(camera: PinholeCamera, pose: RigidPose, seen: Correspondences) -> NDArray[np.float64]:
    """Covariance of a pose fitted to points with independent errors of the stated size.

    Returns
    -------
    NDArray
        Shape (6, 6): rotation vector (rad) and translation (mm) in the body's frame, as `RigidPose.moved` takes them.
    """
    J = projection_jacobian(camera, pose, seen.body_mm) / seen.standard_deviation_px[:, None, None]
    return np.asarray(np.linalg.inv(np.einsum("nik,nil->kl", J, J)))
