"""Limits of legs and joints, at poses and along moves."""

from itertools import pairwise

import numpy as np
import pytest

from shared.geometry.hexapod import ZERO_POSE, HexapodPart, PlatformPose, leg_lengths_mm
from shared.geometry.hexapod_limits import (
    HexapodLimit,
    limit_violations,
    path_violations,
    straight_path,
    within_limits,
)
from shared.geometry.hexapod_workspace import travel_range
from shared.parts.hexapod_file import default_hexapod


@pytest.fixture(scope="module")
def hexapod() -> HexapodPart:
    return default_hexapod()


def pose(**axes: float) -> PlatformPose:
    values = dict.fromkeys(("x_mm", "y_mm", "z_mm", "u_deg", "v_deg", "w_deg"), 0.0) | axes
    return PlatformPose(**values)


def test_zero_pose_is_free(hexapod: HexapodPart) -> None:
    assert limit_violations(hexapod, ZERO_POSE, hexapod.pivot_mm) == ()


def test_a_leg_too_long_is_named_with_its_length_and_limit(hexapod: HexapodPart) -> None:
    violations = limit_violations(hexapod, pose(z_mm=9.0), hexapod.pivot_mm)
    assert {v.limit for v in violations} == {HexapodLimit.LEG_LENGTH}
    assert violations[0].message.startswith("leg 1 would be 53.73 mm long, it can be 37 to 53 mm; remount")


def test_a_leg_too_short_is_refused(hexapod: HexapodPart) -> None:
    assert "36.40 mm" in limit_violations(hexapod, pose(z_mm=-9.0), hexapod.pivot_mm)[0].message


def test_a_joint_bent_too_far_is_named(hexapod: HexapodPart) -> None:
    violations = limit_violations(hexapod, pose(x_mm=19.0, z_mm=-4.0), np.zeros(3))
    assert HexapodLimit.BASE_JOINT in {v.limit for v in violations}
    assert "its limit is 25°" in next(v.message for v in violations if v.limit is HexapodLimit.BASE_JOINT)


def test_top_joints_feel_the_platforms_tilt_that_base_joints_do_not(hexapod: HexapodPart) -> None:
    limits = [v.limit for v in limit_violations(hexapod, pose(u_deg=24.0), np.zeros(3))]
    assert HexapodLimit.TOP_JOINT in limits
    assert HexapodLimit.BASE_JOINT not in limits


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_numbers_that_are_not_finite_are_refused(hexapod: HexapodPart, value: float) -> None:
    (violation,) = limit_violations(hexapod, pose(x_mm=value), hexapod.pivot_mm)
    assert violation.limit is HexapodLimit.NOT_FINITE


@pytest.mark.parametrize("seed", [11])
def test_a_path_between_allowed_ends_may_leave_the_workspace(hexapod: HexapodPart, seed: int) -> None:
    start, end = find_a_bad_path(hexapod, seed)
    assert limit_violations(hexapod, start, np.zeros(3)) == ()
    assert limit_violations(hexapod, end, np.zeros(3)) == ()
    violations = path_violations(hexapod, start, end, np.zeros(3))
    assert violations
    assert violations[0].message.startswith("after ")


def find_a_bad_path(hexapod: HexapodPart, seed: int) -> tuple[PlatformPose, PlatformPose]:
    rng = np.random.default_rng(seed)
    poses = rng.uniform(-1.0, 1.0, (4000, 6)) * [15.0, 15.0, 8.0, 20.0, 20.0, 35.0]
    inside = poses[within_limits(hexapod, poses, np.zeros(3))]
    for a, b in pairwise(inside):
        start, end = PlatformPose.from_array(a), PlatformPose.from_array(b)
        if not within_limits(hexapod, straight_path(start, end), np.zeros(3)).all():
            return start, end
    pytest.fail("no move between allowed poses leaves the workspace: the test needs another robot")


def test_a_path_to_a_forbidden_end_names_the_end(hexapod: HexapodPart) -> None:
    violations = path_violations(hexapod, ZERO_POSE, pose(z_mm=9.0), hexapod.pivot_mm)
    assert violations == limit_violations(hexapod, pose(z_mm=9.0), hexapod.pivot_mm)


def test_path_samples_are_dense_enough_that_no_leg_changes_by_more_than_a_fifth_of_a_millimetre(
    hexapod: HexapodPart,
) -> None:
    path = straight_path(pose(x_mm=-5.0, u_deg=-6.0), pose(y_mm=8.0, v_deg=6.0, w_deg=6.0))
    lengths = leg_lengths_mm(hexapod, path, hexapod.pivot_mm)
    assert np.abs(np.diff(lengths, axis=0)).max() < 0.2
    assert len(straight_path(ZERO_POSE, ZERO_POSE)) == 2


def test_travel_ranges_end_where_the_limits_do(hexapod: HexapodPart) -> None:
    lowest, highest = travel_range(hexapod, hexapod.pivot_mm)
    for ends, outwards in ((lowest, -0.02), (highest, 0.02)):
        for axis in range(6):
            alone = np.zeros(6)
            alone[axis] = ends.as_array()[axis]
            assert limit_violations(hexapod, PlatformPose.from_array(alone), hexapod.pivot_mm) == ()
            alone[axis] += outwards
            assert limit_violations(hexapod, PlatformPose.from_array(alone), hexapod.pivot_mm) != ()


def test_the_platform_reaches_what_the_figures_ask_for(hexapod: HexapodPart) -> None:
    lowest, highest = travel_range(hexapod, np.zeros(3))
    needed = np.array([10.0, 10.0, 8.0, 12.0, 12.0, 12.0])
    assert (highest.as_array() >= needed).all()
    assert (lowest.as_array() <= -needed).all()
