"""What the controller's feedback means, state by state."""

from dataclasses import replace

import pytest

from services.robot.core.controller_feedback import ControllerError, ControllerFeedback
from services.robot.core.guard import PermittedMove
from services.robot.core.motion import Event
from services.robot.core.status import DriveStatus, with_feedback
from services.robot.core.supervision import (
    MoveUnderWay,
    check_at_rest,
    check_held,
    check_moving,
    check_referencing,
    distance_from_path,
)
from services.robot.core.tuning import SUPERVISION
from shared.geometry.hexapod import ZERO_POSE, PlatformPose
from shared.robot_states import MotionState
from tests.unit.services.robot.fake_controller import BUTTON_PRESSED, BUTTON_RELEASED, FAULT, STOPPED

TARGET = PlatformPose(4.0, 0.0, 0.0, 0.0, 0.0, 2.0)
HALF_WAY = PlatformPose(2.0, 0.0, 0.0, 0.0, 0.0, 1.0)
MOVE = MoveUnderWay(PermittedMove("a" * 64, ZERO_POSE, TARGET, 2.0, 2.0), began_s=10.0)
AT_REST = ControllerFeedback(ZERO_POSE, False, False, True, False, True, None)
MOVING = ControllerFeedback(HALF_WAY, True, False, False, True, True, None)
ARRIVED = replace(MOVING, pose=TARGET, moving=False, on_target=True)


def test_a_move_on_its_way_is_left_alone() -> None:
    assert check_moving(MOVE, MOVING, 11.0) is None


def test_a_move_on_its_target_has_arrived() -> None:
    finding = check_moving(MOVE, ARRIVED, 12.0)
    assert finding is not None
    assert finding.event is Event.ARRIVED


@pytest.mark.requirement("ROB-08")
@pytest.mark.parametrize(
    ("feedback", "now_s", "event", "words"),
    [
        (replace(MOVING, error=STOPPED), 11.0, Event.CONTROLLER_STOPPED, "stopped by a command"),
        (replace(MOVING, error=BUTTON_PRESSED), 11.0, Event.CONTROLLER_STOPPED, "stop button is pressed"),
        (replace(MOVING, error=FAULT), 11.0, Event.FAULT_SEEN, "a leg does not follow"),
        (replace(MOVING, unlocked=False), 11.0, Event.FAULT_SEEN, "a servo, a brake"),
        (replace(MOVING, referenced=False), 11.0, Event.FAULT_SEEN, "the reference was lost"),
        (replace(MOVING, pose=replace(HALF_WAY, y_mm=0.6)), 11.0, Event.FAULT_SEEN, "0.600 mm and 0.000° beside"),
        (replace(MOVING, pose=replace(HALF_WAY, u_deg=0.6)), 11.0, Event.FAULT_SEEN, "beside its path"),
        (replace(MOVING, pose=replace(TARGET, x_mm=4.6)), 11.0, Event.FAULT_SEEN, "beside its path"),
        (MOVING, 16.1, Event.FAULT_SEEN, "has taken 6.1 s (limit 6.0 s)"),
        (replace(ARRIVED, pose=replace(TARGET, x_mm=4.06)), 12.0, Event.FAULT_SEEN, "ended 0.060 mm"),
        (replace(ARRIVED, pose=replace(TARGET, u_deg=0.06)), 12.0, Event.FAULT_SEEN, "ended 0.000 mm and 0.060°"),
    ],
)
def test_every_trouble_in_a_move_is_found(feedback: ControllerFeedback, now_s: float, event: Event, words: str) -> None:
    finding = check_moving(MOVE, feedback, now_s)
    assert finding is not None
    assert finding.event is event
    assert words in finding.message


def test_a_robot_that_rests_short_of_its_target_gets_a_second() -> None:
    resting = replace(MOVING, moving=False)
    move = replace(MOVE, at_rest_s=11.0)
    assert check_moving(move, resting, 11.9) is None
    finding = check_moving(move, resting, 12.1)
    assert finding is not None
    assert finding.event is Event.FAULT_SEEN
    assert "stopped 2.000 mm and 1.000° from its target" in finding.message


def test_a_move_and_its_settling_may_last_as_long_as_their_limits() -> None:
    assert check_moving(MOVE, MOVING, MOVE.began_s + MOVE.longest_s) is None
    resting = replace(MOVE, at_rest_s=11.0)
    assert check_moving(resting, replace(MOVING, moving=False), 11.0 + SUPERVISION.settle_s) is None


@pytest.mark.parametrize("state", [MotionState.LOCKED, MotionState.UNREFERENCED, MotionState.STOPPED])
def test_at_rest_and_locked_is_right(state: MotionState) -> None:
    assert check_at_rest(state, AT_REST) is None


@pytest.mark.parametrize(
    ("state", "feedback", "event"),
    [
        (MotionState.LOCKED, replace(AT_REST, moving=True), Event.FAULT_SEEN),
        (MotionState.STOPPED, replace(AT_REST, moving=True), Event.FAULT_SEEN),
        (MotionState.LOCKED, replace(AT_REST, locked=False), Event.FAULT_SEEN),
        (MotionState.UNREFERENCED, replace(AT_REST, locked=False), Event.FAULT_SEEN),
        (MotionState.STOPPED, replace(AT_REST, locked=False), Event.FAULT_SEEN),
        (MotionState.LOCKED, replace(AT_REST, referenced=False), Event.FAULT_SEEN),
        (MotionState.LOCKED, replace(AT_REST, error=FAULT), Event.FAULT_SEEN),
        (MotionState.LOCKED, replace(AT_REST, error=STOPPED), Event.CONTROLLER_STOPPED),
        (MotionState.UNREFERENCED, replace(AT_REST, error=BUTTON_PRESSED), Event.CONTROLLER_STOPPED),
    ],
)
def test_every_trouble_at_rest_is_found(state: MotionState, feedback: ControllerFeedback, event: Event) -> None:
    finding = check_at_rest(state, feedback)
    assert finding is not None
    assert finding.event is event


@pytest.mark.parametrize("error", [STOPPED, BUTTON_PRESSED, BUTTON_RELEASED])
def test_a_stopped_robot_may_report_its_stop(error: ControllerError) -> None:
    assert check_at_rest(MotionState.STOPPED, replace(AT_REST, error=error)) is None


def test_a_locked_robot_that_stays_within_the_read_back_is_held() -> None:
    assert check_held(TARGET, replace(AT_REST, pose=replace(TARGET, x_mm=4.04, w_deg=2.04))) is None


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        (replace(TARGET, y_mm=0.06), "has moved by 0.060 mm and 0.000°"),
        (replace(TARGET, w_deg=2.06), "has moved by 0.000 mm and 0.060°"),
    ],
)
def test_a_locked_robot_that_moves_or_turns_is_a_fault(pose: PlatformPose, words: str) -> None:
    finding = check_held(TARGET, replace(AT_REST, pose=pose))
    assert finding is not None
    assert finding.event is Event.FAULT_SEEN
    assert words in finding.message


@pytest.mark.parametrize(
    ("feedback", "lasted_s", "event"),
    [
        (AT_REST, 0.1, Event.REFERENCE_DONE),
        (replace(AT_REST, referenced=False), 0.1, None),
        (replace(AT_REST, moving=True), 0.1, None),
        (replace(AT_REST, referenced=False), SUPERVISION.reference_timeout_s, None),
        (replace(AT_REST, referenced=False), 61.0, Event.FAULT_SEEN),
        (replace(AT_REST, pose=HALF_WAY), 0.1, Event.FAULT_SEEN),
        (replace(AT_REST, error=FAULT), 0.1, Event.FAULT_SEEN),
        (replace(AT_REST, error=STOPPED), 0.1, Event.CONTROLLER_STOPPED),
    ],
)
def test_reference(feedback: ControllerFeedback, lasted_s: float, event: Event | None) -> None:
    finding = check_referencing(ZERO_POSE, feedback, lasted_s, SUPERVISION.read_back)
    assert (finding.event if finding else None) is event


def test_the_path_ends_at_its_ends() -> None:
    beyond = PlatformPose(5.0, 0.0, 0.0, 0.0, 0.0, 2.0)
    assert distance_from_path(ZERO_POSE, TARGET, beyond).distance_mm == pytest.approx(1.0, abs=0.2)
    assert distance_from_path(ZERO_POSE, TARGET, HALF_WAY).distance_mm == pytest.approx(0.0, abs=1e-12)
    assert distance_from_path(ZERO_POSE, ZERO_POSE, HALF_WAY).distance_mm == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("x_mm", "y_mm", "distance_mm"),
    [(2.0, 5.0, 0.0), (2.0, 5.5, 0.5), (1.8, 4.7, 0.3), (0.0, 5.0, 1.0), (3.7, 5.0, 1.0)],
)
def test_the_distance_from_a_path_is_that_from_its_nearest_place(x_mm: float, y_mm: float, distance_mm: float) -> None:
    start, target = (PlatformPose(x, 5.0, 0.0, 0.0, 0.0, 0.0) for x in (1.0, 2.7))
    pose = PlatformPose(x_mm, y_mm, 0.0, 0.0, 0.0, 0.0)
    assert distance_from_path(start, target, pose).distance_mm == pytest.approx(distance_mm, abs=1e-9)


def test_a_path_shorter_than_a_millimetre_has_a_middle() -> None:
    target, middle = (PlatformPose(x, 0.0, 0.0, 0.0, 0.0, 0.0) for x in (0.8, 0.4))
    assert distance_from_path(ZERO_POSE, target, middle).distance_mm == pytest.approx(0.0, abs=1e-12)


def test_feedback_while_moving_without_a_move_is_a_fault() -> None:
    _, finding = with_feedback(DriveStatus(state=MotionState.MOVING), MOVING, 0.0, 0.0)
    assert finding is not None
    assert finding.event is Event.FAULT_SEEN
    _, finding = with_feedback(DriveStatus(state=MotionState.REFERENCING), MOVING, 0.0, 0.0)
    assert finding is not None
    assert finding.event is Event.FAULT_SEEN


def test_a_robot_that_shifts_when_locked_is_a_fault() -> None:
    status = DriveStatus(state=MotionState.LOCKED, outcome="moving", task=MOVE)
    _, finding = with_feedback(status, replace(AT_REST, pose=replace(TARGET, x_mm=4.1)), 0.0, 0.0)
    assert finding is not None
    assert "locking moved the robot 0.100 mm" in finding.message
