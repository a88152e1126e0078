"""Screw moves: what they keep, and that they are looked at all the way."""

import numpy as np
import pytest

from shared.geometry.hexapod import ZERO_POSE, HexapodPart, PlatformPose, base_from_top
from shared.geometry.hexapod_limits import HexapodLimit, limit_violations
from shared.geometry.hexapod_screw import screw_path, screw_violations
from shared.parts.hexapod_file import default_hexapod

START = PlatformPose(-3.0, 1.0, 0.5, 4.0, -2.0, 3.0)
END = PlatformPose(4.0, -2.0, -1.0, -3.0, 3.0, -6.0)


@pytest.fixture(scope="module")
def hexapod() -> HexapodPart:
    return default_hexapod()


def test_a_screw_begins_and_ends_where_it_should_in_small_equal_steps(hexapod: HexapodPart) -> None:
    path = screw_path(hexapod, START, END, hexapod.pivot_mm)
    np.testing.assert_allclose(path[0], START.as_array(), atol=1e-9)
    np.testing.assert_allclose(path[-1], END.as_array(), atol=1e-9)
    steps_mm = np.linalg.norm(np.diff(path[:, :3], axis=0), axis=1)
    assert steps_mm.max() <= 0.05 + 1e-9


def test_along_a_screw_its_axis_stays_where_it_is(hexapod: HexapodPart) -> None:
    first = base_from_top(hexapod, START, hexapod.pivot_mm).rigid
    turns = [
        (base_from_top(hexapod, PlatformPose.from_array(pose), hexapod.pivot_mm).rigid * first.inv()).as_exp_coords()
        for pose in screw_path(hexapod, START, END, hexapod.pivot_mm)[1:]
    ]
    axes = np.array([turn / np.linalg.norm(turn[:3]) for turn in turns])
    np.testing.assert_allclose(axes, np.broadcast_to(axes[-1], axes.shape), atol=1e-6)


def test_a_screw_without_rotation_is_the_straight_line(hexapod: HexapodPart) -> None:
    path = screw_path(hexapod, ZERO_POSE, PlatformPose(3.0, -4.0, 0.0, 0.0, 0.0, 0.0), hexapod.pivot_mm)
    np.testing.assert_allclose(path[:, 1], -4.0 / 3.0 * path[:, 0], atol=1e-9)
    assert len(path) == 101
    assert len(screw_path(hexapod, ZERO_POSE, ZERO_POSE, hexapod.pivot_mm)) == 2


def test_a_screw_that_leaves_the_workspace_between_allowed_ends_is_refused(hexapod: HexapodPart) -> None:
    # Between these two, found by trying many, a leg would be too short.
    start, end = PlatformPose(10.2, 1.2, -5.0, 6.6, 0.7, -4.7), PlatformPose(-1.8, -4.7, -5.0, 1.1, 14.2, 5.0)
    assert limit_violations(hexapod, start, np.zeros(3)) == ()
    assert limit_violations(hexapod, end, np.zeros(3)) == ()
    violations = screw_violations(hexapod, start, end, np.zeros(3))
    assert {v.limit for v in violations} == {HexapodLimit.LEG_LENGTH}
    assert violations[0].message.startswith("after 28 % of the way, leg 6 would be 37.00 mm long")
    assert screw_violations(hexapod, START, END, np.zeros(3)) == ()
