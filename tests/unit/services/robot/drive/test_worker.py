"""The drive, one round of work at a time: faults, silence, and leaving."""

from dataclasses import replace

import pytest

from services.robot.core.controller_feedback import ControllerError
from services.robot.core.refusals import Refusal, RefusalCode
from services.robot.core.status import DriveStatus
from services.robot.devices.controller import ControllerFault
from shared.errors import DeviceError
from shared.geometry.hexapod import PlatformPose
from shared.robot_states import MotionState, StopButton
from shared.threads import faults_go_to
from tests.unit.services.robot.drive_bench import Bench
from tests.unit.services.robot.fake_controller import BUTTON_PRESSED, BUTTON_RELEASED, FAULT, STOPPED


def assert_accepted(refusal: Refusal | None) -> None:
    assert refusal is None


def test_lost_supervision_stops_a_move_and_nothing_else(bench: Bench) -> None:
    bench.make_ready()
    bench.drive.supervision_lost("the gateway was silent")
    assert bench.has(MotionState.LOCKED)
    assert not bench.controller.stopped
    assert bench.begin_move() is None
    bench.work(1)
    bench.drive.supervision_lost("the gateway was silent")
    assert bench.has(MotionState.STOPPED)
    assert bench.controller.feedback.locked
    assert bench.drive.status.detail == "the gateway was silent"


def test_a_worker_that_failed_leaves_no_line_open() -> None:
    bench = Bench()

    def fail() -> None:
        raise ZeroDivisionError("no case for it")

    bench.controller.after_read = fail
    reported: list[str] = []

    class Listener:
        def fail(self, message: str) -> None:
            reported.append(message)

        def note_error(self, place: str, error: BaseException) -> None:
            raise AssertionError(place) from error

    with faults_go_to(Listener()):
        bench.drive.start()
        bench.drive._thread.join(60.0)
        bench.drive.close()
    assert bench.controller.closed
    assert reported == ["thread 'drive' ended with ZeroDivisionError: no case for it"]


def test_silence_during_a_move_stops_and_is_a_fault(bench: Bench) -> None:
    bench.start_move()
    bench.controller.failures = ["the hexapod controller is silent"]
    bench.work(1)
    assert bench.has(MotionState.FAULT)
    assert bench.controller.stopped
    assert bench.controller.feedback.locked


def test_in_fault_the_robot_is_locked_again_until_it_is(bench: Bench) -> None:
    bench.start_move()
    bench.controller.brakes_hold = False
    bench.controller.failures = ["the hexapod controller is silent"]
    bench.work(3)
    assert bench.has(MotionState.FAULT)
    bench.controller.brakes_hold = True
    bench.work(2)
    assert bench.controller.feedback.locked


def test_a_fault_is_left_by_connecting_anew_and_acknowledging(bench: Bench) -> None:
    bench.make_ready()
    bench.controller.failures = ["the hexapod controller is silent"]
    bench.work()
    assert bench.begin_move() is not None
    refusal = bench.drive.acknowledge_stop()
    assert refusal is not None
    assert refusal.code is RefusalCode.IN_FAULT
    bench.now_s += 5.0
    assert bench.drive.reset() is None
    bench.work()
    assert bench.controller.closed
    assert bench.has(MotionState.STOPPED)
    assert bench.drive.status.connected_s == bench.now_s


def test_a_brake_that_lets_go_at_rest_is_a_fault_and_is_locked_again(bench: Bench) -> None:
    bench.make_ready()
    bench.controller.feedback = replace(bench.controller.feedback, locked=False)
    bench.work(1)
    assert bench.has(MotionState.FAULT)
    assert "the guide is not held" in bench.drive.status.detail
    bench.work(1)
    assert bench.controller.feedback.locked


def test_a_robot_that_cannot_be_locked_is_a_fault(bench: Bench) -> None:
    bench.start_move()
    bench.controller.brakes_hold = False
    bench.drive.stop("test")
    bench.work(1)
    assert bench.has(MotionState.FAULT)
    assert "does not lock" in bench.drive.status.detail


@pytest.mark.requirement("ROB-15")
def test_a_stop_by_the_controllers_own_button_is_noticed(bench: Bench) -> None:
    bench.start_move()
    bench.controller.stop_now()
    bench.work(1)
    assert bench.has(MotionState.STOPPED)
    assert "not by this service: the controller was stopped by a command" in bench.drive.status.detail


@pytest.mark.requirement("ROB-14")
def test_reference_that_moves_an_absolute_robot_is_a_fault(bench: Bench) -> None:
    bench.work()
    bench.drive.acknowledge_stop()
    bench.work()
    assert bench.drive.begin_reference("r1") is None
    bench.controller.feedback = replace(bench.controller.feedback, pose=PlatformPose(1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    bench.work(1)
    assert bench.has(MotionState.FAULT)
    assert "reference moved the robot by 1.000 mm" in bench.drive.status.detail


@pytest.mark.requirement("ROB-08")
def test_a_move_that_takes_too_long_is_a_fault(bench: Bench) -> None:
    bench.start_move()
    bench.now_s += 4.6
    bench.work(1)
    assert bench.has(MotionState.FAULT)
    assert "has taken 4.6 s (limit 4.5 s)" in bench.drive.status.detail


def test_the_guard_sees_the_present_and_may_refuse(bench: Bench) -> None:
    bench.make_ready()
    seen: list[DriveStatus] = []

    def guard(status: DriveStatus) -> Refusal:
        seen.append(status)
        return Refusal(RefusalCode.PLAN_STALE, "stale")

    outcome = bench.drive.begin_move("m1", guard)
    assert outcome is not None
    assert outcome.code is RefusalCode.PLAN_STALE
    assert seen[0].fresh_feedback(bench.now_s) is not None
    bench.work()
    assert bench.controller.motions == []


def test_a_reading_older_than_half_a_second_does_not_count(bench: Bench) -> None:
    bench.work()
    bench.now_s += 0.6
    refusal = bench.drive.acknowledge_stop()
    assert refusal is not None
    assert refusal.code is RefusalCode.POSE_UNKNOWN


def test_leaving_stops_locks_and_disconnects(bench: Bench) -> None:
    bench.start_move()
    bench.drive.leave()
    assert bench.controller.feedback.locked
    while bench.drive.step():
        pass
    assert bench.controller.closed
    assert bench.has(MotionState.DISCONNECTED)
    assert bench.outcome == "stopped"


def test_leaving_while_connecting_leaves_the_controller_locked_and_closed(bench: Bench) -> None:
    bench.drive.leave()
    bench.drive.step()
    assert bench.has(MotionState.DISCONNECTED)


def test_a_fault_of_the_program_stops_the_robot_and_is_told() -> None:
    bench = Bench()
    bench.start_move()

    def crash() -> None:
        raise ZeroDivisionError("a bug")

    bench.controller.read = crash  # type: ignore[assignment,method-assign]
    with pytest.raises(ZeroDivisionError):
        bench.drive.work()
    assert bench.has(MotionState.FAULT)
    assert bench.controller.feedback.locked
    assert bench.crashes == ["ZeroDivisionError: a bug"]


def test_a_controller_that_is_slow_at_rest_is_asked_again(bench: Bench) -> None:
    bench.make_ready()
    bench.controller.silent = True
    bench.now_s += 0.9
    bench.work(1)
    assert bench.has(MotionState.LOCKED)
    assert bench.drive.status.feedback is None, "what is not known must not be told"
    bench.controller.silent = False
    bench.work(1)
    assert bench.drive.status.feedback is not None


@pytest.mark.requirement("GW-04")
def test_a_robot_that_moved_while_its_controller_was_slow_is_a_fault(bench: Bench) -> None:
    """Gateway and registration rely on it: what was seen before stays seen while a slow controller is asked again."""
    bench.make_ready()
    bench.controller.silent = True
    bench.now_s += 0.9
    bench.work(1)
    bench.controller.silent = False
    bench.controller.feedback = replace(bench.controller.feedback, pose=PlatformPose(0.2, 0.0, 0.0, 0.0, 0.0, 0.0))
    bench.work(1)
    assert bench.has(MotionState.FAULT)
    assert "the locked robot has moved" in bench.drive.status.detail


def test_a_controller_that_stays_silent_at_rest_is_a_fault(bench: Bench) -> None:
    bench.make_ready()
    bench.controller.silent = True
    bench.now_s += 1.1
    bench.work(1)
    assert bench.has(MotionState.FAULT)


def test_a_fault_reported_in_the_round_that_a_move_overtakes_ends_the_move(bench: Bench) -> None:
    bench.make_ready()
    bench.controller.feedback = replace(bench.controller.feedback, error=FAULT)
    bench.after_the_next_round(lambda: assert_accepted(bench.begin_move()))
    bench.work(2)
    assert bench.has(MotionState.FAULT)
    assert bench.drive.status.detail == FAULT.message
    assert bench.controller.motions == []


def test_a_fault_reported_in_the_round_that_a_stop_overtakes_is_a_fault(bench: Bench) -> None:
    bench.start_move()
    bench.controller.feedback = replace(bench.controller.feedback, error=FAULT)
    bench.after_the_next_round(lambda: bench.drive.stop("test"))
    bench.work(2)
    assert bench.has(MotionState.FAULT)
    assert bench.drive.status.detail == FAULT.message


@pytest.mark.parametrize(
    ("error", "state", "button"),
    [
        (FAULT, MotionState.FAULT, StopButton.CLEAR),
        (BUTTON_PRESSED, MotionState.STOPPED, StopButton.PRESSED),
        (BUTTON_RELEASED, MotionState.STOPPED, StopButton.RELEASED),
        (STOPPED, MotionState.STOPPED, StopButton.CLEAR),
    ],
)
def test_what_is_reported_in_the_round_that_an_acknowledgement_overtakes_counts(
    bench: Bench, error: ControllerError, state: MotionState, button: StopButton
) -> None:
    bench.make_ready()
    bench.drive.stop("test")
    bench.work(2)
    bench.controller.feedback = replace(bench.controller.feedback, error=error)
    bench.after_the_next_round(lambda: assert_accepted(bench.drive.acknowledge_stop()))
    bench.work(1)
    assert bench.has(state)
    assert bench.drive.status.stop_button is button


def test_a_stop_of_our_own_that_is_reported_after_the_next_stop_is_no_fault(bench: Bench) -> None:
    bench.start_move()
    bench.drive.stop("first")
    bench.after_the_next_round(lambda: bench.drive.stop("second"))
    bench.work(2)
    assert bench.has(MotionState.STOPPED)
    assert bench.drive.status.detail == "second"


@pytest.mark.parametrize(
    ("error", "state"),
    [
        (ControllerFault("locking failed: a leg does not follow"), MotionState.FAULT),
        (DeviceError("the brakes are still on their way"), MotionState.STOPPED),
    ],
)
def test_a_fault_of_an_effect_that_a_stop_overtakes_is_not_dropped(
    bench: Bench, error: DeviceError, state: MotionState
) -> None:
    bench.start_move()

    def fail() -> None:
        bench.controller.before_lock = lambda: None
        bench.drive.stop("second")
        raise error

    bench.controller.before_lock = fail
    bench.drive.stop("first")
    bench.work(2)
    assert bench.has(state)
    assert bench.drive.status.detail == (str(error) if state is MotionState.FAULT else "second")


def test_a_stop_in_fault_leaves_the_faults_sentence_and_further_errors_stand_behind_it(bench: Bench) -> None:
    bench.start_move()
    bench.controller.feedback = replace(bench.controller.feedback, error=FAULT)
    bench.work(2)
    bench.drive.stop("'console' asked for a stop")
    bench.work(2)
    assert bench.drive.status.detail == FAULT.message
    further = replace(FAULT, message="a leg has met its limit switch")
    for _ in range(2):
        bench.controller.feedback = replace(bench.controller.feedback, error=further)
        bench.work(1)
    assert bench.drive.status.detail == f"{FAULT.message}; then: {further.message}"


def test_what_locking_meets_in_fault_stands_behind_the_fault_and_a_noisy_line_makes_no_endless_sentence(
    bench: Bench,
) -> None:
    bench.start_move()
    bench.controller.feedback = replace(bench.controller.feedback, error=FAULT)

    def fail() -> None:
        raise ControllerFault("locking failed: a leg has met its limit switch")

    bench.controller.before_lock = fail
    bench.work(2)
    behind = f"{FAULT.message}; then: locking failed: a leg has met its limit switch"
    assert bench.drive.status.detail == behind
    for code in range(9):
        bench.controller.feedback = replace(
            bench.controller.feedback, error=replace(FAULT, message=f"error {code}"), locked=True
        )
        bench.work(1)
    assert bench.drive.status.detail == f"{behind}; then: error 0; then: error 1"


@pytest.mark.requirement("ROB-08")
def test_a_controller_that_is_silent_in_a_move_is_a_fault_at_once(bench: Bench) -> None:
    bench.start_move()
    bench.controller.silent = True
    bench.work(1)
    assert bench.has(MotionState.FAULT)
    assert bench.controller.stopped
