"""How far the guide's balls lie from where its file puts them, beyond their measurement: the guide as built.

Each ball's displacement is a random effect with one standard deviation for all of them. It is estimated only where the
residuals are larger than measurement explains: a covariance that is estimated from few balls is itself uncertain.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from services.registration.core.estimation.image_points import (
    Body,
    Correspondences,
    projection_jacobian,
    residuals_px,
)
from services.registration.core.tuning import GUIDE_AS_BUILT
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera
from shared.geometry.transform import Transform

_POSE_SIZE = 6
_LARGEST_MM = 10.0


def px_per_mm(
    camera: PinholeCamera, camera_from_body: Transform[Camera, Body], body_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Pixels by which a millimetre across the beam shows at points, shape (N, 3); shape (N,)."""
    return np.asarray(camera.focal_length_px / camera_from_body.points(body_mm)[:, 2])


def displacement_sd_mm(
    camera: PinholeCamera,
    camera_from_body: Transform[Camera, Body],
    seen: Correspondences,
    shared_px2: NDArray[np.float64],
) -> float:
    """Standard deviation per axis of the balls' places about their file's; 0 where measurement explains the residuals.

    Solves for the spread with which chi-square is what its degrees of freedom predict (DerSimonian and Laird, Meta-
    analysis in clinical trials, 1986).

    Parameters
    ----------
    seen
        With the standard deviations of the balls' own errors, stated tolerances included.
    shared_px2
        Covariance per axis of errors that balls share, shape (N, N).
    """
    freedom = 2 * len(seen) - _POSE_SIZE
    if freedom < GUIDE_AS_BUILT.least_freedom:
        return 0.0
    J, residual = (
        projection_jacobian(camera, camera_from_body, seen.body_mm),
        residuals_px(camera, camera_from_body, seen),
    )
    scale = px_per_mm(camera, camera_from_body, seen.body_mm)

    def excess(spread_mm: float) -> float:
        own = np.diag(seen.standard_deviation_px**2 + (spread_mm * scale) ** 2)
        return _chi_square(J, residual, shared_px2 + own) / freedom

    if excess(0.0) < GUIDE_AS_BUILT.largest_chi_square:
        return 0.0
    if excess(_LARGEST_MM) > 1.0:
        return _LARGEST_MM
    return float(brentq(lambda spread_mm: excess(spread_mm) - 1.0, 0.0, _LARGEST_MM, xtol=1e-4))


def planes_farther_apart(
    camera: PinholeCamera, camera_from_body: Transform[Camera, Body], seen: Correspondences
) -> tuple[float, float]:
    """Scale of the body along its z axis over that across it, less one, and the share of chi-square that it explains.

    The scale of the whole body is not measurable: a larger one farther away gives the same image.
    """
    weight = 1.0 / seen.standard_deviation_px[:, None, None]
    J = projection_jacobian(camera, camera_from_body, seen.body_mm)
    stretch = J[:, :, 5:] * seen.body_mm[:, 2, None, None]
    design = (np.concatenate([J, stretch], axis=2) * weight).reshape(-1, _POSE_SIZE + 1)
    target = (residuals_px(camera, camera_from_body, seen) * weight[..., 0]).ravel()
    before = target - design[:, :-1] @ np.linalg.lstsq(design[:, :-1], target, rcond=None)[0]
    found = np.linalg.lstsq(design, target, rcond=None)[0]
    after = target - design @ found
    return float(found[-1]), 1.0 - float(after @ after) / max(float(before @ before), 1e-12)


def _chi_square(
    jacobian: NDArray[np.float64], residual_px: NDArray[np.float64], covariance_px2: NDArray[np.float64]
) -> float:
    """Of what no pose explains, both axes having the same covariance, shape (N, N)."""
    root = np.linalg.cholesky(covariance_px2)
    whitened = np.linalg.solve(root, residual_px)
    design = np.linalg.solve(root, jacobian.reshape(len(jacobian), -1)).reshape(jacobian.shape)
    rows, target = design.reshape(-1, _POSE_SIZE), whitened.ravel()
    left = target - rows @ np.linalg.lstsq(rows, target, rcond=None)[0]
    return float(left @ left)
