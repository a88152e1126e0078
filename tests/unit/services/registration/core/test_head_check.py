"""The guide's hold checked by the first image and by the first move: what is refused, and what must not be."""

from dataclasses import replace

import numpy as np
import pytest

from services.registration.core.acceptance.criteria import HeadTrouble
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.head_check import (
    MotionView,
    c_arm_stood_still,
    check_motion,
    check_place,
    observed_motion,
)
from shared.acceptance import Refusal
from shared.geometry.frames import Guide, Nail, Ring, RobotBase, RobotTop
from shared.geometry.hexapod import ZERO_POSE, HexapodPart, PlatformPose, base_from_top
from shared.geometry.hexapod_mount import MountPlace
from shared.geometry.transform import Transform
from shared.parts.hexapod_file import default_hexapod

HEXAPOD = default_hexapod()
ENTERED_MM = 60.0
LATER = PlatformPose(4.0, -5.0, 0.0, 2.0, -5.0, 5.0)
GUIDE_COVARIANCE = np.diag([*np.radians([0.025, 0.025, 0.006]), 0.01, 0.01, 0.1]) ** 2
NAIL_COVARIANCE = np.diag([*np.radians([0.15, 0.15, 0.05]), 0.03, 0.03, 0.3]) ** 2
SOURCE_MM, SOURCE_COVARIANCE_MM2 = np.array([3.0, 4.0, -1000.0]), np.diag([0.03, 0.03, 0.4]) ** 2
RING_FROM_BASE: Transform[Ring, RobotBase] = Transform.from_rotvec([0.1, 0.05, 1.0], [20.0, -10.0, -330.0])
GUIDE_FROM_NAIL: Transform[Guide, Nail] = Transform.from_rotvec([0.05, -0.03, 0.02], [1.0, 2.0, 105.0])

Head = Transform[RobotTop, Guide]


def views(
    head: Head, later: PlatformPose = LATER, c_arm_deg: float = 0.0, slip_mm: float = 0.0
) -> tuple[MotionView, MotionView]:
    """Exact images of a guide held so, before and after a move."""
    ring_from_nail = RING_FROM_BASE @ base_from_top(HEXAPOD, ZERO_POSE, HEXAPOD.pivot_mm) @ head @ GUIDE_FROM_NAIL
    made = []
    for pose, turned_deg, slipped_mm in ((ZERO_POSE, 0.0, 0.0), (later, c_arm_deg, slip_mm)):
        c_arm: Transform[Ring, Ring] = Transform.from_rotvec(np.radians([turned_deg, 0.0, 0.0]), np.zeros(3))
        slip: Transform[RobotBase, RobotBase] = Transform.from_rotvec(np.zeros(3), [0.0, slipped_mm, slipped_mm])
        guide = c_arm @ RING_FROM_BASE @ slip @ base_from_top(HEXAPOD, pose, HEXAPOD.pivot_mm) @ head
        guide_estimate = PoseEstimate.of(guide, GUIDE_COVARIANCE)
        nail_estimate = PoseEstimate.of(c_arm @ ring_from_nail, NAIL_COVARIANCE)
        made.append(MotionView(pose, guide_estimate, nail_estimate, SOURCE_MM, SOURCE_COVARIANCE_MM2))
    return made[0], made[1]


def held(rotation_deg: tuple[float, float, float], shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Head:
    off: Transform[Guide, Guide] = Transform.from_rotvec(np.radians(rotation_deg), shift_mm)
    return HEXAPOD.top_from_guide(ENTERED_MM) @ off


def code(before: MotionView, after: MotionView) -> HeadTrouble | None:
    refused = check_motion(HEXAPOD, ENTERED_MM, before, after)
    print(refused)
    return None if refused is None else refused.code


@pytest.mark.parametrize("c_arm_deg", [0.0, 4.0])
def test_a_guide_that_moves_as_told_is_let_pass(c_arm_deg: float) -> None:
    assert code(*views(held((0.0, 0.0, 0.0)), c_arm_deg=c_arm_deg)) is None
    assert code(*views(held((1.0, -0.8, 1.2), (0.8, -0.9, 0.7)), c_arm_deg=c_arm_deg)) is None


@pytest.mark.parametrize(("really_mm", "said"), [(70.0, "at 70 ±"), (50.0, "at 50 ±")])
def test_an_extension_that_is_10_mm_wrong_shows_in_a_move_that_turns(really_mm: float, said: str) -> None:
    before, after = views(HEXAPOD.top_from_guide(really_mm))
    refused = check_motion(HEXAPOD, ENTERED_MM, before, after)
    assert refused is not None
    assert refused.code is HeadTrouble.HEAD_EXTENSION
    assert said in refused.message
    assert "entered is 60 mm, a difference of " in refused.message
    assert "mm (limit 4 mm); read its scale again" in refused.message


def test_a_move_that_does_not_turn_cannot_tell_the_extension() -> None:
    shifted = PlatformPose(4.0, -5.0, 1.0, 0.0, 0.0, 0.0)
    assert code(*views(HEXAPOD.top_from_guide(70.0), shifted)) is None


@pytest.mark.requirement("REG-11")
@pytest.mark.parametrize("c_arm_deg", [0.0, 4.0])
@pytest.mark.parametrize(
    ("turn_deg", "said"), [((0.0, 0.0, 180.0), "turned by 180°"), ((0.0, 0.0, 90.0), "turned by 90°")]
)
def test_a_guide_put_on_turned_shows_in_any_move(
    turn_deg: tuple[float, float, float], said: str, c_arm_deg: float
) -> None:
    for later in (LATER, PlatformPose(3.0, 2.0, 0.0, 0.0, 0.0, 0.0)):
        refused = check_motion(HEXAPOD, ENTERED_MM, *views(held(turn_deg), later, c_arm_deg))
        assert refused is not None
        assert refused.code is HeadTrouble.GUIDE_TURNED
        assert said in refused.message
        assert "report step mount_moved" in refused.message


def test_a_mount_that_slipped_is_not_taken_for_either() -> None:
    assert code(*views(held((0.0, 0.0, 0.0)), slip_mm=3.0)) is None


def test_a_c_arm_that_was_turned_is_no_reference() -> None:
    still, turned = (views(held((0.0, 0.0, 0.0)), c_arm_deg=a) for a in (0.0, 4.0))
    assert c_arm_stood_still(*still)
    assert not c_arm_stood_still(*turned)
    for before, after in (still, turned):
        motion = observed_motion(before, after)
        expected = base_from_top(HEXAPOD, LATER, HEXAPOD.pivot_mm) @ held((0.0, 0.0, 0.0))
        start = base_from_top(HEXAPOD, ZERO_POSE, HEXAPOD.pivot_mm) @ held((0.0, 0.0, 0.0))
        np.testing.assert_allclose(motion.mean.matrix, (start.inverse() @ expected).matrix, atol=1e-9)
    spreads = [np.trace(observed_motion(*pair).covariance[3:, 3:]) for pair in (still, turned)]
    assert spreads[1] > 3.0 * spreads[0], "the nail is the weaker reference"


FIRST_POSE = PlatformPose(1.0, -2.0, 0.5, 3.0, -2.0, 4.0)
SEEN_IN_FIRST_IMAGE: Transform[Guide, Nail] = Transform.from_rotvec(np.radians([2.0, -3.0, 1.5]), [2.0, -3.0, 105.0])


def with_mount(off_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> HexapodPart:
    """A robot whose file knows where the mount on the nail's head holds it; the nail is off from there."""
    hexapod = default_hexapod()
    true = (
        base_from_top(hexapod, FIRST_POSE, hexapod.pivot_mm) @ hexapod.top_from_guide(ENTERED_MM) @ SEEN_IN_FIRST_IMAGE
    )
    designed: Transform[RobotBase, Nail] = Transform.from_rotation_translation(
        true.rotation, true.translation_mm - off_mm
    )
    mount = MountPlace("nail_head", designed, np.array([3.0, 5.0, 5.0]), 10.0)
    return replace(hexapod, mounts=(mount,))


def checked(
    hexapod: HexapodPart, entered_mm: float = ENTERED_MM, mount: str = "nail_head"
) -> Refusal[HeadTrouble] | None:
    return check_place(hexapod, FIRST_POSE, entered_mm, SEEN_IN_FIRST_IMAGE, mount)


def test_what_fits_the_mount_is_let_pass() -> None:
    assert checked(with_mount()) is None
    assert checked(with_mount((2.9, -4.9, 4.9))) is None


@pytest.mark.requirement("REG-11")
@pytest.mark.parametrize(("entered_mm", "fitting"), [(50.0, "60 mm would fit"), (70.0, "60 mm would fit")])
def test_an_extension_entered_10_mm_wrong_is_noticed_from_the_first_image(entered_mm: float, fitting: str) -> None:
    refused = checked(with_mount(), entered_mm)
    assert refused is not None
    assert refused.code is HeadTrouble.HEAD_EXTENSION
    assert f"{entered_mm - 60.0:+.1f}"[:3] in refused.message
    assert f"entered as {entered_mm:g} mm, {fitting}" in refused.message
    assert "(limit 3 mm)" in refused.message


def test_a_mount_that_sits_elsewhere_is_told() -> None:
    refused = checked(with_mount((0.0, 6.0, -7.0)))
    assert refused is not None
    assert refused.code is HeadTrouble.MOUNT_PLACE
    assert "+6.0 mm along y (limit 5 mm), -7.0 mm along z (limit 5 mm)" in refused.message


def test_of_a_mount_that_no_file_describes_only_directions_are_known() -> None:
    assert checked(with_mount((0.0, 60.0, -70.0)), mount="bone") is None
    assert checked(default_hexapod(), entered_mm=45.0) is None


@pytest.mark.requirement("REG-11")
@pytest.mark.parametrize("turn_deg", [(0.0, 0.0, 180.0), (0.0, 0.0, 90.0), (180.0, 0.0, 0.0), (0.0, 35.0, 0.0)])
def test_a_guide_on_turned_is_noticed_from_the_first_image(turn_deg: tuple[float, float, float]) -> None:
    turned: Transform[Guide, Guide] = Transform.from_rotvec(np.radians(turn_deg), np.zeros(3))
    refused = check_place(default_hexapod(), FIRST_POSE, ENTERED_MM, turned @ SEEN_IN_FIRST_IMAGE, "bone")
    assert refused is not None
    assert refused.code is HeadTrouble.GUIDE_TURNED
    assert "(limit 30°)" in refused.message
    assert "put the guide on the head with its distal mark to the distal end" in refused.message
