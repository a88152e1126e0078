"""What the balls' residuals say about the guide's errors."""

from importlib.resources import files

import numpy as np
import pytest

from services.registration.core.pose import Correspondences, RigidPose, covariance_by_residuals, refine_pose
from shared.geometry.camera import PinholeCamera
from shared.parts.files import guide_from_json

CAMERA = PinholeCamera(np.array([[4400.0, 0.0, 512.0], [0.0, 4400.0, 512.0], [0.0, 0.0, 1.0]]))
POSE = RigidPose(np.eye(3), np.array([5.0, -3.0, 640.0]))
STATED_PX = 0.06
DRAWS = 200


@pytest.mark.parametrize(("true_px", "lowest", "highest"), [(0.06, 0.85, 1.15), (0.03, 0.8, 1.15), (0.12, 0.85, 1.2)])
def test_predicted_errors_follow_the_residuals(true_px: float, lowest: float, highest: float) -> None:
    guide = guide_from_json(files("shared.parts").joinpath("catalogue/guide-28.json").read_bytes())
    body, rng = guide.balls.position_mm, np.random.default_rng(31)
    normalised = []
    for _ in range(DRAWS):
        ideal_px = CAMERA.project(POSE.points(body)) + rng.normal(0.0, true_px, (len(body), 2))
        seen = Correspondences(body, ideal_px, np.full(len(body), STATED_PX))
        found = refine_pose(CAMERA, POSE, seen)
        covariance = covariance_by_residuals(CAMERA, found, seen)
        moved_mm = found.rotation.T @ (POSE.translation_mm - found.translation_mm)
        normalised.append(moved_mm / np.sqrt(np.diag(covariance)[3:]))
    rms = np.sqrt(np.mean(np.square(normalised), axis=0))
    print(f"{true_px} px instead of {STATED_PX} px: {rms}")
    assert np.all((rms > lowest) & (rms < highest))
