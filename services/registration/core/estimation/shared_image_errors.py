"""Pose of a rigid body from image points that share part of their errors: robust generalised least squares.

Points near each other in an image share the error of its distortion. The pose and those shared errors are fitted
together: the shared ones have the covariance that the calibration states, and what is left at each point is its own,
with Cauchy's loss against outliers.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.image_points import (
    Body,
    Correspondences,
    projection_jacobian,
    residuals_px,
)
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.estimation.robust import robust_weight
from services.registration.core.tuning import ROBUST_POINT_FIT
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera
from shared.geometry.transform import Transform

# Numerical guards: the last step is a hundredth of what the centre of a ball is known to.
_ROUNDS = 20
_CONVERGED_PX = 1e-4
# Variance of the estimate over that of least squares when errors are normal and as large as stated.
_AS_STATED = 1.16
_FREEDOM_OF_STATED = 4
_LEAST_SLOPE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class _Normal:
    """Normal equations under one covariance of the points' errors."""

    precision: NDArray[np.float64]  # inverse covariance per axis, shape (N, N)
    whitened: NDArray[np.float64]  # it times the Jacobian, shape (N, 2, 6)
    covariance: NDArray[np.float64]  # of the pose, shape (6, 6)


def fit_with_shared_errors(
    camera: PinholeCamera, start: Transform[Camera, Body], seen: Correspondences, shared_px2: NDArray[np.float64]
) -> PoseEstimate[Camera, Body]:
    """Move a pose to where it explains the points best.

    Minimises the sum of Cauchy's loss of each point's own error and of the shared errors' square in units of their
    covariance, over the pose and the shared errors, by re-weighted Gauss-Newton steps.

    Parameters
    ----------
    start
        Near enough that all weights make sense: where `refine_pose` converged.
    shared_px2
        Covariance per axis of the errors that points share, shape (N, N); those of `seen` are their own.
    """
    variance = seen.standard_deviation_px**2
    pose, total = start, variance + np.diag(shared_px2)
    weight = _weights(residuals_px(camera, pose, seen) / np.sqrt(total)[:, None])
    own = np.zeros_like(seen.ideal_px)
    for _ in range(_ROUNDS):
        J, residual = projection_jacobian(camera, pose, seen.body_mm), residuals_px(camera, pose, seen)
        normal = _normal(J, shared_px2 + np.diag(variance / weight))
        step = normal.covariance @ np.einsum("nik,ni->k", normal.whitened, residual)
        pose = pose.moved(step)
        own = (variance / weight)[:, None] * (normal.precision @ residuals_px(camera, pose, seen))
        weight = _weights(own / seen.standard_deviation_px[:, None])
        if float(np.abs(J @ step).max()) < _CONVERGED_PX:
            break
    covariance = _covariance(projection_jacobian(camera, pose, seen.body_mm), seen, shared_px2, own)
    return PoseEstimate.of(pose, covariance)


def _weights(deviations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Robust weights, shape (N,), of errors over their standard deviations, shape (N, 2)."""
    return robust_weight(np.linalg.norm(deviations, axis=1), ROBUST_POINT_FIT.scale_sigmas)


def _normal(jacobian: NDArray[np.float64], covariance_px2: NDArray[np.float64]) -> _Normal:
    precision = np.asarray(np.linalg.inv(covariance_px2))
    whitened = np.tensordot(precision, jacobian, axes=1)
    information = np.tensordot(jacobian, whitened, axes=([0, 1], [0, 1]))
    return _Normal(precision, whitened, np.asarray(np.linalg.inv(information)))


def _covariance(
    jacobian: NDArray[np.float64],
    seen: Correspondences,
    shared_px2: NDArray[np.float64],
    own_px: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Covariance of the pose, shape (6, 6): the points' own errors by the residuals, the shared ones as stated.

    Neighbours' shared errors hardly show in the residuals. An M-estimate of errors of variance v is as uncertain as
    least squares of errors of variance v times Huber's factor.
    """
    variance = seen.standard_deviation_px**2
    as_stated = _normal(jacobian, shared_px2 + np.diag(variance))
    # what neither the pose nor the shared errors take up
    taken_by_pose = np.einsum("nik,kl,nil,n->", as_stated.whitened, as_stated.covariance, as_stated.whitened, variance)
    freedom = max(2.0 * float(np.diag(as_stated.precision) @ variance) - float(taken_by_pose), 1.0)
    factor = _variance_factor(own_px / seen.standard_deviation_px[:, None], freedom)
    return _normal(jacobian, shared_px2 + factor * np.diag(variance)).covariance


def _variance_factor(deviations: NDArray[np.float64], freedom: float) -> float:
    """Variance of an M-estimate over that of least squares with the stated errors.

    Huber's formula: the mean square of the influence function over the square of its mean slope, with his correction
    for few points. The stated standard deviations count as a few degrees of freedom, which matters when there are
    hardly more points than a pose needs.
    """
    weight = _weights(deviations)[:, None]
    slopes = weight - 2.0 * (deviations / ROBUST_POINT_FIT.scale_sigmas * weight) ** 2
    slope = max(float(slopes.mean()), _LEAST_SLOPE)
    few = 1.0 + 6.0 / deviations.size * float(slopes.var()) / slope**2
    found = few**2 * float(np.sum((deviations * weight) ** 2)) / freedom / slope**2
    return (found * freedom + _AS_STATED * _FREEDOM_OF_STATED) / (freedom + _FREEDOM_OF_STATED)
