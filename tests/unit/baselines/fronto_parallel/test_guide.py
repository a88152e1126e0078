"""The paper's guide: principal axes, pose from points, and its refusals, on discs without an image."""

from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from baselines.fronto_parallel.guide import locate_guide_by_axes, pose_on_axes
from shared.errors import Accepted, ReasonCode, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, BallCandidates, CArmCalibration
from shared.geometry.frames import Camera, Guide
from shared.geometry.parts import BallPattern, RingPart
from shared.geometry.transform import Transform
from shared.parts.files import guide_from_json
from tests.unit.services.registration.xray_scene import FOCAL_PX, calibration

SIZE_PX = 900
GUIDE = guide_from_json(files("shared.parts").joinpath("catalogue/guide-28.json").read_bytes())
FAR_AWAY = RingPart(BallPattern(("R0",), np.array([[900.0, 0.0, 0.0]]), np.array([2.0])), (), "0" * 64)


def posed(tilt_xy_deg: tuple[float, float], spin_deg: float) -> Transform[Camera, Guide]:
    turn = Rotation.from_euler("xy", tilt_xy_deg, degrees=True) * Rotation.from_euler("z", spin_deg, degrees=True)
    return Transform.from_rotation_translation(turn.as_matrix(), np.array([6.0, -4.0, 640.0]))


def with_discs(
    camera_from_guide: Transform[Camera, Guide], balls: NDArray[np.int64], noise_px: float
) -> CArmCalibration:
    """A calibrated image with discs at some of the guide's balls and at ten other places."""
    rng, view = np.random.default_rng(12), calibration(SIZE_PX)
    seen = view.image_from_camera(camera_from_guide @ GUIDE.balls.position_mm[balls])
    centre = np.vstack([seen + noise_px * rng.standard_normal(seen.shape), rng.uniform(50.0, 850.0, (10, 2))])
    count = len(centre)
    none_named = np.full(count, NOT_OF_THE_RING, dtype=np.int64)
    discs = BallCandidates(centre, np.full(count, FOCAL_PX / 640.0), np.ones(count), np.full(count, 0.1), none_named)
    return replace(view, balls=discs)


@pytest.mark.parametrize("tilt_xy_deg", [(0.0, 0.0), (6.0, -5.0)])
def test_the_pose_is_that_of_the_balls(tilt_xy_deg: tuple[float, float]) -> None:
    true = posed(tilt_xy_deg, 33.0)
    result = locate_guide_by_axes(with_discs(true, np.arange(3, 25), 0.1), FAR_AWAY, GUIDE)
    assert isinstance(result, Accepted), result
    fit = result.value
    assert fit.balls_found >= 20
    off = fit.camera_from_guide.inverse() @ true
    assert np.degrees(np.linalg.norm(off.rotation_vector_rad)) < 0.3
    assert np.linalg.norm(off.translation_mm[:2]) < 0.2


@pytest.mark.parametrize("turned_over", [False, True])
@pytest.mark.parametrize("spin_deg", [0.0, 100.0, 215.0])
def test_principal_axes_alone_come_near(spin_deg: float, turned_over: bool) -> None:  # noqa: FBT001  # a parameter
    true = posed((0.0, 0.0), spin_deg)
    rotation = true.rotation @ (np.diag([1.0, -1.0, -1.0]) if turned_over else np.eye(3))
    camera = calibration(SIZE_PX).camera
    seen = camera.project(GUIDE.balls.position_mm @ rotation.T + true.translation_mm)
    pose = pose_on_axes(camera, GUIDE.balls.position_mm, seen, 640.0)
    assert np.linalg.det(pose.rotation) == pytest.approx(1.0)
    assert np.degrees(Rotation.from_matrix(rotation.T @ pose.rotation).magnitude()) < 3.0


def test_without_a_guide_there_is_none() -> None:
    result = locate_guide_by_axes(with_discs(posed((0.0, 0.0), 0.0), np.zeros(0, np.int64), 0.1), FAR_AWAY, GUIDE)
    assert isinstance(result, Rejected)
    assert result.reasons[0].code in {ReasonCode.GUIDE_NOT_FOUND, ReasonCode.GUIDE_AMBIGUOUS}


def test_few_balls_are_refused() -> None:
    result = locate_guide_by_axes(with_discs(posed((2.0, 1.0), 20.0), np.arange(0, 27, 3), 0.1), FAR_AWAY, GUIDE)
    assert isinstance(result, Rejected)
    assert result.reasons[0].code is ReasonCode.GUIDE_TOO_FEW_BALLS
    assert "limit" in result.reasons[0].message
