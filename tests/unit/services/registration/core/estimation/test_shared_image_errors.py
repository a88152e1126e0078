"""What the balls' residuals and the distortion's stated errors say about the guide's pose."""

from importlib.resources import files

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.estimation.image_points import Correspondences, refine_pose
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.estimation.shared_image_errors import fit_with_shared_errors
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Guide
from shared.geometry.transform import Transform
from shared.parts.files import guide_from_json

CAMERA = PinholeCamera(np.array([[4400.0, 0.0, 512.0], [0.0, 4400.0, 512.0], [0.0, 0.0, 1.0]]))
POSE: Transform[Camera, Guide] = Transform.from_rotation_translation(np.eye(3), [5.0, -3.0, 640.0])
STATED_PX = 0.06
SHARED_PX, SHARED_LENGTH_PX = 0.1, 80.0
DRAWS = 200

BODY_MM = guide_from_json(files("shared.parts").joinpath("catalogue/guide-28.json").read_bytes()).balls.position_mm
EXACT_PX = CAMERA.project(POSE.points(BODY_MM))
NOTHING_SHARED = np.zeros((len(BODY_MM), len(BODY_MM)))


def _shared_covariance() -> NDArray[np.float64]:
    apart = np.linalg.norm(EXACT_PX[:, None] - EXACT_PX[None], axis=-1)
    return np.asarray(SHARED_PX**2 * np.exp(-0.5 * (apart / SHARED_LENGTH_PX) ** 2))


def _seen(offset_px: NDArray[np.float64]) -> Correspondences:
    return Correspondences(BODY_MM, EXACT_PX + offset_px, np.full(len(BODY_MM), STATED_PX))


def _fitted(seen: Correspondences, shared_px2: NDArray[np.float64]) -> PoseEstimate[Camera, Guide]:
    return fit_with_shared_errors(CAMERA, refine_pose(CAMERA, POSE, seen), seen, shared_px2)


def _error_mm(pose: Transform[Camera, Guide]) -> NDArray[np.float64]:
    return np.asarray(pose.rotation.T @ (POSE.translation_mm - pose.translation_mm))


@pytest.mark.parametrize(("true_px", "lowest", "highest"), [(0.06, 0.85, 1.15), (0.03, 0.8, 1.15), (0.12, 0.85, 1.25)])
def test_predicted_errors_follow_the_residuals(true_px: float, lowest: float, highest: float) -> None:
    rng, normalised = np.random.default_rng(31), []
    for _ in range(DRAWS):
        fit = _fitted(_seen(rng.normal(0.0, true_px, EXACT_PX.shape)), NOTHING_SHARED)
        normalised.append(_error_mm(fit.mean) / np.sqrt(np.diag(fit.covariance)[3:]))
    rms = np.sqrt(np.mean(np.square(normalised), axis=0))
    print(f"{true_px} px instead of {STATED_PX} px: {rms}")
    assert np.all((rms > lowest) & (rms < highest))


def test_shared_errors_are_weighed_and_predicted() -> None:
    shared, rng = _shared_covariance(), np.random.default_rng(32)
    factor = np.linalg.cholesky(shared + 1e-9 * np.eye(len(shared)))
    errors, as_if_independent, normalised = [], [], []
    for _ in range(DRAWS):
        drawn = factor @ rng.normal(size=EXACT_PX.shape) + rng.normal(0.0, STATED_PX, EXACT_PX.shape)
        seen = _seen(drawn)
        fit = _fitted(seen, shared)
        errors.append(_error_mm(fit.mean))
        as_if_independent.append(_error_mm(refine_pose(CAMERA, POSE, seen)))
        normalised.append(errors[-1] / np.sqrt(np.diag(fit.covariance)[3:]))
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.mean(np.square(as_if_independent), axis=0))
    rms = np.sqrt(np.mean(np.square(normalised), axis=0))
    print(f"error over that of a fit as if independent: {ratio}; over predicted: {rms}")
    assert np.all(ratio < 0.97)
    assert np.all((rms > 0.85) & (rms < 1.2))


def test_a_ball_beside_its_place_hardly_moves_the_pose() -> None:
    shared, offset = _shared_covariance(), np.zeros_like(EXACT_PX)
    offset[4] = 1.5, -0.8
    robust = _fitted(_seen(offset), shared)
    predicted = np.sqrt(np.diag(robust.covariance)[3:])
    moved = np.abs(_error_mm(robust.mean)) / predicted
    print(f"moved by {moved} of the predicted errors")
    assert np.all(moved < 0.2)


def test_nothing_shared_is_the_plain_robust_fit() -> None:
    seen = _seen(np.random.default_rng(33).normal(0.0, STATED_PX, EXACT_PX.shape))
    plain, fit = refine_pose(CAMERA, POSE, seen), _fitted(seen, NOTHING_SHARED)
    assert fit.mean.points(BODY_MM) == pytest.approx(plain.points(BODY_MM), abs=1e-3)
