"""The mean of predicted and seen nail, weighed by their errors."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from services.registration.core.guidance.nail_tracking import weighed
from services.registration.core.pose_evidence import motion_of_nail
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.transform import Transform

PREDICTED: Transform[Camera, Nail] = Transform.from_rotvec([0.05, -0.02, 0.6], [3.0, -4.0, 700.0])
STEP: Transform[Nail, Nail] = Transform.from_rotvec([0.01, 0.004, -0.002], [0.2, -0.1, 1.0])
SEEN = PREDICTED @ STEP
ONE = np.diag([1e-5, 1e-5, 1e-6, 0.01, 0.01, 1.0])


def turn_deg(a: Transform[Camera, Nail], b: Transform[Camera, Nail]) -> float:
    return float(np.degrees(np.linalg.norm((a.inverse() @ b).rotation_vector_rad)))


def test_the_surer_of_the_two_prevails() -> None:
    pose, covariance = weighed(PREDICTED, 1e-6 * ONE, SEEN, ONE)
    assert turn_deg(pose, PREDICTED) < 1e-4
    assert np.allclose(covariance, 1e-6 * ONE, rtol=0.01)
    pose, covariance = weighed(PREDICTED, ONE, SEEN, 1e-6 * ONE)
    assert turn_deg(pose, SEEN) < 1e-4
    assert np.allclose(covariance, 1e-6 * ONE, rtol=0.01)


def test_equal_ones_meet_in_the_middle_and_promise_less_than_independent_ones_would() -> None:
    pose, covariance = weighed(PREDICTED, ONE, SEEN, ONE)
    assert turn_deg(pose, PREDICTED) == pytest.approx(0.5 * turn_deg(SEEN, PREDICTED), rel=1e-6)
    # half the variance if independent, all of it if the same: three quarters with a correlation of one half
    assert np.allclose(covariance, 0.75 * ONE)


def test_the_guides_error_moves_the_nail_through_its_lever() -> None:
    guide_from_nail: Transform[Guide, Nail] = Transform.from_rotvec([0.0, 0.1, 0.3], [5.0, -2.0, 107.0])
    rng = np.random.default_rng(3)
    errors = rng.normal(0.0, [1e-4, 2e-4, 1e-4, 0.01, 0.02, 0.05], (4000, 6))
    moved = []
    for error in errors:
        guide: Transform[Guide, Guide] = Transform.from_rotation_translation(
            Rotation.from_rotvec(error[:3]).as_matrix(), error[3:]
        )
        of_nail = guide_from_nail.inverse() @ guide @ guide_from_nail
        moved.append(np.concatenate([of_nail.rotation_vector_rad, of_nail.translation_mm]))
    by_guide = motion_of_nail(guide_from_nail)
    expected = by_guide @ np.diag(np.var(errors, axis=0)) @ by_guide.T
    assert np.allclose(np.var(moved, axis=0), np.diag(expected), rtol=0.1)
