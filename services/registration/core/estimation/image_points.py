"""Pose of a rigid body from where its points appear in the image: robust least squares.

The inner loop is compiled, because the guide's search runs it hundreds of times. Poses are bare arrays there: compiled
loops take no objects.
"""

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.robust import cauchy_cost, cauchy_weight, robust_weight
from services.registration.core.tuning import ROBUST_POINT_FIT
from shared.compiled import compiled, compiled_inline
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Frame
from shared.geometry.transform import Transform

Body = TypeVar("Body", bound=Frame)

# Numerical guards of Levenberg-Marquardt, which ends when a step lowers the cost by less than a billionth.
_ITERATIONS = 30
# Below it the series' next term is under the rounding error.
_SMALL_ANGLE_RAD = 1e-8
_CONVERGED = 1e-9
_LEAST_DAMPING, _FIRST_DAMPING, _DAMPING_FACTOR = 1e-12, 1e-3, 10.0
_LEAST_CURVATURE = 1e-12

# rotation, shape (3, 3), and translation in mm, shape (3,)
Pose = tuple[NDArray[np.float64], NDArray[np.float64]]


class Observed(NamedTuple):
    """Points of a body, shape (N, 3), and where they were observed, shape (N, 2).

    `scale_px`, shape (N,): distances at which a point's weight has fallen to a half.
    """

    body_mm: NDArray[np.float64]
    px: NDArray[np.float64]
    scale_px: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Correspondences:
    """Points of a body and where they were observed."""

    body_mm: NDArray[np.float64]  # shape (N, 3)
    ideal_px: NDArray[np.float64]  # undistorted pixels, shape (N, 2)
    standard_deviation_px: NDArray[np.float64]  # per axis, shape (N,)

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


def reprojection_rms_px(
    camera: PinholeCamera, camera_from_body: Transform[Camera, Body], seen: Correspondences
) -> float:
    """Rms distance of observed points from where a pose puts them."""
    return float(np.sqrt(np.mean(np.sum(residuals_px(camera, camera_from_body, seen) ** 2, axis=1))))


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
    """Covariance, shape (6, 6), of a pose fitted to points with independent errors of the stated size."""
    J = projection_jacobian(camera, camera_from_body, seen.body_mm) / seen.standard_deviation_px[:, None, None]
    return np.asarray(np.linalg.inv(np.einsum("nik,nil->kl", J, J)))


@compiled_inline
def _turn(rotvec: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrix of a rotation vector (Rodrigues' formula), shape (3, 3)."""
    angle = np.sqrt(np.sum(rotvec * rotvec))
    x, y, z = rotvec[0], rotvec[1], rotvec[2]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < _SMALL_ANGLE_RAD:
        return np.asarray(np.eye(3) + cross)
    half = np.sin(0.5 * angle) / (0.5 * angle)
    return np.asarray(np.eye(3) + np.sin(angle) / angle * cross + 0.5 * half * half * (cross @ cross))


@compiled_inline
def _stepped(pose: Pose, step: NDArray[np.float64]) -> Pose:
    """A pose after a step in the body's own frame: rotation vector (rad) and translation (mm), shape (6,).

    Equal to `Transform.moved` to first order, which is all that steps of Levenberg-Marquardt need.
    """
    rotation, translation_mm = pose
    return rotation @ _turn(step[:3]), translation_mm + rotation @ step[3:]


@compiled
def jacobian_row(
    intrinsic: NDArray[np.float64],
    rotation: NDArray[np.float64],
    at_camera_mm: NDArray[np.float64],
    body_mm: NDArray[np.float64],
    axis: int,
    out: NDArray[np.float64],
) -> None:
    """How one coordinate of a point's image moves with the pose, shape (6,), px per rad and px per mm."""
    x, y, z = at_camera_mm[0], at_camera_mm[1], at_camera_mm[2]
    if axis == 0:
        gx, gy, gz = intrinsic[0, 0] / z, intrinsic[0, 1] / z, -(intrinsic[0, 0] * x + intrinsic[0, 1] * y) / z**2
    else:
        gx, gy, gz = 0.0, intrinsic[1, 1] / z, -intrinsic[1, 1] * y / z**2
    for i in range(3):
        out[3 + i] = gx * rotation[0, i] + gy * rotation[1, i] + gz * rotation[2, i]
    # a turn by w moves the body's point b by w x b, so its derivative is b x gradient
    out[0] = body_mm[1] * out[5] - body_mm[2] * out[4]
    out[1] = body_mm[2] * out[3] - body_mm[0] * out[5]
    out[2] = body_mm[0] * out[4] - body_mm[1] * out[3]


@compiled_inline
def _place(pose: Pose, body_mm: NDArray[np.float64], at_camera_mm: NDArray[np.float64]) -> None:
    rotation, translation_mm = pose
    x, y, z = body_mm[0], body_mm[1], body_mm[2]
    for i in range(3):
        at_camera_mm[i] = rotation[i, 0] * x + rotation[i, 1] * y + rotation[i, 2] * z + translation_mm[i]


@compiled_inline
def _residual(
    intrinsic: NDArray[np.float64], at_camera_mm: NDArray[np.float64], seen_px: NDArray[np.float64]
) -> tuple[float, float]:
    x, y = at_camera_mm[0] / at_camera_mm[2], at_camera_mm[1] / at_camera_mm[2]
    return (
        seen_px[0] - (intrinsic[0, 0] * x + intrinsic[0, 1] * y + intrinsic[0, 2]),
        seen_px[1] - (intrinsic[1, 1] * y + intrinsic[1, 2]),
    )


@compiled_inline
def _cost(intrinsic: NDArray[np.float64], pose: Pose, seen: Observed) -> float:
    cost, at_camera_mm = 0.0, np.empty(3)
    for n in range(seen.px.shape[0]):
        _place(pose, seen.body_mm[n], at_camera_mm)
        across, down = _residual(intrinsic, at_camera_mm, seen.px[n])
        cost += cauchy_cost((across * across + down * down) / seen.scale_px[n] ** 2)
    return cost


@compiled_inline
def _normal_equations(
    intrinsic: NDArray[np.float64], pose: Pose, seen: Observed
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normal matrix, shape (6, 6), and gradient, shape (6,), with Cauchy weights."""
    normal, gradient, row, at_camera_mm = np.zeros((6, 6)), np.zeros(6), np.empty(6), np.empty(3)
    for n in range(seen.px.shape[0]):
        _place(pose, seen.body_mm[n], at_camera_mm)
        residual = _residual(intrinsic, at_camera_mm, seen.px[n])
        ratio = (residual[0] * residual[0] + residual[1] * residual[1]) / seen.scale_px[n] ** 2
        weight = cauchy_weight(ratio) / seen.scale_px[n] ** 2
        for axis in range(2):
            jacobian_row(intrinsic, pose[0], at_camera_mm, seen.body_mm[n], axis, row)
            for i in range(6):
                gradient[i] += weight * residual[axis] * row[i]
                for k in range(6):
                    normal[i, k] += weight * row[i] * row[k]
    return normal, gradient


@compiled
def refined(intrinsic: NDArray[np.float64], start: Pose, seen: Observed, most_steps: int) -> Pose:
    """Levenberg-Marquardt with Cauchy weights (see `refine_pose`); intrinsic matrix in px, shape (3, 3)."""
    pose, damping = start, _FIRST_DAMPING
    cost = _cost(intrinsic, pose, seen)
    normal, gradient = _normal_equations(intrinsic, pose, seen)
    for _ in range(most_steps):
        curvature = np.diag(normal) + _LEAST_CURVATURE
        trial = _stepped(pose, np.linalg.solve(normal + damping * np.diag(curvature), gradient))
        trial_cost = _cost(intrinsic, trial, seen)
        if trial_cost > cost:
            damping *= _DAMPING_FACTOR
            continue
        converged = cost - trial_cost < _CONVERGED * (1.0 + cost)
        pose, cost, damping = trial, trial_cost, max(damping / _DAMPING_FACTOR, _LEAST_DAMPING)
        if converged:
            break
        normal, gradient = _normal_equations(intrinsic, pose, seen)
    return pose
