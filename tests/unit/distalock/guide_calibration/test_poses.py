"""Suggested poses: reachable, apart, and enough rotation."""

import numpy as np

from distalock.guide_calibration.acceptance import GuideRefusalCode
from distalock.guide_calibration.poses import suggested_poses
from shared.geometry.hexapod_limits import limit_violations
from tests.unit.distalock.guide_calibration.views import EXTENSION_MM, HEXAPOD, NOMINAL, codes, exact_views


def test_suggested_poses_can_be_reached_turn_enough_and_differ() -> None:
    poses = suggested_poses(HEXAPOD, EXTENSION_MM, 6)
    assert len(poses) == 6
    values = np.array([pose.as_array() for pose in poses])
    apart = np.linalg.norm(values[:, None] - values[None], axis=-1)
    assert apart[np.triu_indices(6, 1)].min() > 9.9
    assert all(limit_violations(HEXAPOD, pose, HEXAPOD.pivot_mm) == () for pose in poses)
    assert GuideRefusalCode.TOO_LITTLE_ROTATION not in codes(NOMINAL, exact_views(NOMINAL, poses))
