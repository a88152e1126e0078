"""Hexapod: there and back again for any pose and pivot."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from shared.geometry.hexapod import PlatformPose, base_from_top, leg_lengths_mm, platform_pose
from shared.geometry.hexapod_forward import poses_from_leg_lengths
from shared.geometry.hexapod_limits import limit_violations, path_violations, straight_path, within_limits
from shared.parts.hexapod_file import default_hexapod

HEXAPOD = default_hexapod()
MILLIMETRES = st.floats(-20.0, 20.0)
DEGREES = st.floats(-30.0, 30.0)
POSES = st.builds(PlatformPose, MILLIMETRES, MILLIMETRES, MILLIMETRES, DEGREES, DEGREES, DEGREES)
SMALL_POSES = st.builds(PlatformPose, *[st.floats(-4.0, 4.0)] * 6)
PIVOTS = st.tuples(*[st.floats(-100.0, 100.0)] * 3).map(np.array)
# The machine may be busy: how long an example takes is not what is tested.
UNHURRIED = settings(deadline=None)


@UNHURRIED
@given(POSES, PIVOTS)
def test_pose_to_transform_and_back(pose: PlatformPose, pivot_mm: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    back = platform_pose(HEXAPOD, base_from_top(HEXAPOD, pose, pivot_mm), pivot_mm)
    np.testing.assert_allclose(back.as_array(), pose.as_array(), atol=1e-9)


@UNHURRIED
@given(SMALL_POSES)
def test_leg_lengths_to_pose_and_back(pose: PlatformPose) -> None:
    lengths = leg_lengths_mm(HEXAPOD, pose.as_array()[None], HEXAPOD.pivot_mm)
    (found,) = poses_from_leg_lengths(HEXAPOD, lengths, HEXAPOD.pivot_mm)
    np.testing.assert_allclose(found, pose.as_array(), atol=1e-9)


@UNHURRIED
@given(POSES)
def test_sentences_and_the_vectorised_check_agree(pose: PlatformPose) -> None:
    inside = bool(within_limits(HEXAPOD, pose.as_array(), HEXAPOD.pivot_mm))
    assert (limit_violations(HEXAPOD, pose, HEXAPOD.pivot_mm) == ()) is inside


@UNHURRIED
@given(SMALL_POSES, SMALL_POSES)
def test_a_path_is_free_exactly_when_every_pose_on_it_is(start: PlatformPose, end: PlatformPose) -> None:
    inside = bool(within_limits(HEXAPOD, straight_path(start, end), HEXAPOD.pivot_mm).all())
    assert (path_violations(HEXAPOD, start, end, HEXAPOD.pivot_mm) == ()) is inside
