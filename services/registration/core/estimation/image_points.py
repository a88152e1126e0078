"""Pose of a rigid body from where its points appear in the image: robust least squares."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.image_points_kernel import Observed, jacobian_row, refined
from services.registration.core.estimation.robust import robust_weight
from services.registration.core.tuning import ROBUST_POINT_FIT
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Frame
from shared.geometry.transform import Transform

Body = TypeVar("Body", bound=Frame)

_ITERATIONS = 30


@dataclass(frozen=True, slots=True, eq=False)
class Correspondences:
    """Points of a body and where they were observed.

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


def residuals_px(
    camera: PinholeCamera, camera_from_body: Transform[Camera, Body], seen: Correspondences
) -> NDArray[np.float64]:
    """Observed minus projected, ideal pixels, shape (N, 2)."""
    return seen.ideal_px - camera.project(camera_from_body.points(seen.body_mm))


def projection_jacobian(
    camera: PinholeCamera, camera_from_body: Transform[Camera, Body], body_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How projections move with a small motion of the body in its own frame, shape (N, 2, 6), px per rad and per mm."""
    jacobian, rotation = np.empty((len(body_mm), 2, 6)), camera_from_body.rotation
    for point_mm, at_camera_mm, rows in zip(body_mm, camera_from_body.points(body_mm), jacobian, strict=True):
        for axis in range(2):
            jacobian_row(camera.intrinsic_matrix_px, rotation, at_camera_mm, point_mm, axis, rows[axis])
    return jacobian


def refine_pose(
    camera: PinholeCamera, start: Transform[Camera, Body], seen: Correspondences, most_steps: int = _ITERATIONS
) -> Transform[Camera, Body]:
    """Move a pose to where it explains the points best, with Cauchy weights against outliers.

    Levenberg-Marquardt on at least three points; the start must be near enough to project all points in front of the
    focal spot.
    """
    pose = np.ascontiguousarray(start.rotation), np.ascontiguousarray(start.translation_mm)
    return Transform.from_rotation_translation(*refined(camera.intrinsic_matrix_px, pose, observed(seen), most_steps))


def observed(seen: Correspondences) -> Observed:
    """The same points for the compiled loop."""
    return Observed(
        np.ascontiguousarray(seen.body_mm),
        np.ascontiguousarray(seen.ideal_px),
        ROBUST_POINT_FIT.scale_sigmas * seen.standard_deviation_px,
    )


def down_weighted(
    camera: PinholeCamera, camera_from_body: Transform[Camera, Body], seen: Correspondences
) -> Correspondences:
    """The same points with the standard deviations that their weights in `refine_pose` amount to."""
    deviations = np.linalg.norm(residuals_px(camera, camera_from_body, seen), axis=1) / seen.standard_deviation_px
    weight = robust_weight(deviations, ROBUST_POINT_FIT.scale_sigmas)
    return Correspondences(seen.body_mm, seen.ideal_px, seen.standard_deviation_px / np.sqrt(weight))


def pose_covariance(
    camera: PinholeCamera, camera_from_body: Transform[Camera, Body], seen: Correspondences
) -> NDArray[np.float64]:
    """Covariance of a pose fitted to points with independent errors of the stated size.

    Returns
    -------
    NDArray
        Shape (6, 6), of a small motion of the body in its own frame (see `Transform.exp`).
    """
    J = projection_jacobian(camera, camera_from_body, seen.body_mm) / seen.standard_deviation_px[:, None, None]
    return np.asarray(np.linalg.inv(np.einsum("nik,nil->kl", J, J)))
