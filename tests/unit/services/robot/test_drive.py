"""The drive on a controller without a line, one round of work at a time."""

import threading
import time
from collections.abc import Iterator
from dataclasses import replace

import pytest

from services.robot.core.guard import PermittedMove
from services.robot.core.motion import MotionState
from services.robot.core.readings import READ_BACK_TOLERANCE
from services.robot.core.refusals import Refusal, RefusalCode
from services.robot.core.status import DriveStatus
from services.robot.drive import Drive
from shared.errors import DeviceError
from shared.geometry.hexapod import ZERO_POSE, PlatformPose
from tests.unit.services.robot.fake_controller import FakeController

TARGET = PlatformPose(2.0, 0.0, 0.0, 0.0, 0.0, 0.0)
MOVE = PermittedMove("a" * 64, ZERO_POSE, TARGET, 2.0, 1.0)


class Bench:
    """A drive, its controller and its clock."""

    def __init__(self) -> None:
        self.controller = FakeController()
        self.reachable = True
        self.now_s = 50.0
        self.crashes: list[str] = []
        self.drive = Drive(self._connect, READ_BACK_TOLERANCE, lambda: self.now_s, 1.0, self.crashes.append)

    def _connect(self) -> FakeController:
        if not self.reachable:
            raise DeviceError("the controller cannot be reached; check its cable")
        return self.controller

    def has(self, state: MotionState) -> bool:
        return self.drive.status.state is state

    def work(self, rounds: int = 2) -> None:
        for _ in range(rounds):
            self.drive.step()

    @property
    def outcome(self) -> str:
        return self.drive.status.outcome

    def make_ready(self) -> None:
        self.work()
        assert self.drive.acknowledge_stop() is None
        self.work()
        assert self.drive.begin_reference("r1") is None
        self.work()
        assert self.has(MotionState.LOCKED)

    def begin_move(self) -> Refusal | None:
        return self.drive.begin_move("m1", lambda _: MOVE)

    def start_move(self) -> None:
        self.make_ready()
        assert self.begin_move() is None
        self.work(1)
        assert self.controller.reading.unlocked


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    assert made.crashes == []


def test_a_controller_that_cannot_be_reached_is_tried_again(bench: Bench) -> None:
    bench.reachable = False
    bench.work()
    assert bench.has(MotionState.DISCONNECTED)
    assert "cannot be reached" in bench.drive.status.detail
    bench.reachable = True
    bench.work()
    assert bench.has(MotionState.STOPPED)


def test_the_way_from_start_to_ready_needs_a_person_and_reference(bench: Bench) -> None:
    bench.work()
    assert bench.has(MotionState.STOPPED)
    assert bench.controller.stopped
    refusal = bench.drive.begin_reference("r0")
    assert refusal is not None
    assert refusal.code is RefusalCode.STOP_IN_FORCE
    bench.make_ready()
    assert not bench.controller.stopped
    assert bench.outcome == "reached"


def test_a_move_ends_locked_on_its_target(bench: Bench) -> None:
    bench.start_move()
    assert bench.has(MotionState.MOVING)
    assert bench.outcome == "moving"
    bench.controller.arrive()
    bench.work(1)
    bench.work(1)
    assert bench.has(MotionState.LOCKED)
    assert bench.controller.reading.locked
    assert bench.outcome == "reached"
    assert bench.drive.status.deviation is not None
    assert bench.drive.status.deviation.distance_mm == 0.0


def test_the_outcome_is_not_told_before_the_lock_is_read_back(bench: Bench) -> None:
    bench.start_move()
    bench.controller.arrive()
    bench.work(1)
    assert bench.outcome == "moving"


def test_a_move_that_ends_beside_its_target_is_a_fault(bench: Bench) -> None:
    bench.start_move()
    bench.controller.arrive(PlatformPose(1.94, 0.0, 0.0, 0.0, 0.0, 0.0))
    bench.work()
    assert bench.has(MotionState.FAULT)
    assert "0.060 mm and 0.000° from its target" in bench.drive.status.detail
    assert bench.outcome == "failed"
    assert bench.controller.reading.locked


def test_a_stop_during_a_move_locks_at_once_and_the_position_is_known(bench: Bench) -> None:
    bench.start_move()
    bench.drive.stop("test")
    assert bench.has(MotionState.STOPPED)
    assert bench.controller.reading.locked
    bench.work(1)
    assert bench.outcome == "stopped"
    assert bench.drive.status.fresh_reading(bench.now_s) is not None
    assert len(bench.controller.motions) == 1


def test_a_stop_before_the_worker_begins_the_move_keeps_it_from_beginning(bench: Bench) -> None:
    bench.make_ready()
    assert bench.begin_move() is None
    bench.drive.stop("test")
    bench.work()
    assert bench.controller.asked_to_move == 0
    assert bench.has(MotionState.STOPPED)


def test_a_stop_while_the_worker_begins_the_move_keeps_it_from_beginning(bench: Bench) -> None:
    bench.make_ready()
    assert bench.begin_move() is None
    bench.controller.before_move = lambda: bench.drive.stop("test")
    bench.work()
    assert bench.controller.motions == []
    assert bench.has(MotionState.STOPPED)


def test_a_stop_does_not_wait_for_a_decision_that_is_being_made(bench: Bench) -> None:
    bench.make_ready()
    stopping = threading.Thread(target=bench.drive.stop, args=("test",))

    def guard(_: DriveStatus) -> PermittedMove:
        stopping.start()
        deadline = time.monotonic() + 5.0
        while not bench.controller.stopped:
            assert time.monotonic() < deadline, "the stop waits for the guard"
        return MOVE

    assert bench.drive.begin_move("m1", guard) is None
    stopping.join()
    bench.work()
    assert bench.controller.asked_to_move == 0
    assert bench.has(MotionState.STOPPED)


def test_a_reading_from_before_a_stop_says_nothing_about_the_time_after(bench: Bench) -> None:
    bench.start_move()
    bench.controller.after_read = lambda: bench.drive.stop("test")
    bench.work(1)
    bench.controller.after_read = lambda: None
    assert bench.has(MotionState.STOPPED)
    assert bench.drive.status.detail == "test"
    assert bench.drive.status.fresh_reading(bench.now_s) is None
    bench.work(1)
    assert bench.has(MotionState.STOPPED)


def test_what_is_not_locked_yet_cannot_be_acknowledged(bench: Bench) -> None:
    bench.work()
    bench.drive.stop("once more")
    refusal = bench.drive.acknowledge_stop()
    assert refusal is not None
    assert refusal.code is RefusalCode.POSE_UNKNOWN, "no reading since the last stop"


def test_lost_supervision_stops_a_move_and_nothing_else(bench: Bench) -> None:
    bench.make_ready()
    bench.drive.supervision_lost("the gateway was silent")
    assert bench.has(MotionState.LOCKED)
    assert not bench.controller.stopped
    assert bench.begin_move() is None
    bench.work(1)
    bench.drive.supervision_lost("the gateway was silent")
    assert bench.has(MotionState.STOPPED)
    assert bench.controller.reading.locked
    assert bench.drive.status.detail == "the gateway was silent"


def test_silence_during_a_move_stops_and_is_a_fault(bench: Bench) -> None:
    bench.start_move()
    bench.controller.failures = ["the hexapod controller is silent"]
    bench.work(1)
    assert bench.has(MotionState.FAULT)
    assert bench.controller.stopped
    assert bench.controller.reading.locked


def test_in_fault_the_robot_is_locked_again_until_it_is(bench: Bench) -> None:
    bench.start_move()
    bench.controller.brakes_hold = False
    bench.controller.failures = ["the hexapod controller is silent"]
    bench.work(3)
    assert bench.has(MotionState.FAULT)
    bench.controller.brakes_hold = True
    bench.work(2)
    assert bench.controller.reading.locked


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
    bench.controller.reading = replace(bench.controller.reading, locked=False)
    bench.work(1)
    assert bench.has(MotionState.FAULT)
    assert "the guide is not held" in bench.drive.status.detail
    bench.work(1)
    assert bench.controller.reading.locked


def test_a_robot_that_cannot_be_locked_is_a_fault(bench: Bench) -> None:
    bench.start_move()
    bench.controller.brakes_hold = False
    bench.drive.stop("test")
    bench.work(1)
    assert bench.has(MotionState.FAULT)
    assert "does not lock" in bench.drive.status.detail


def test_a_stop_by_the_controllers_own_button_is_noticed(bench: Bench) -> None:
    bench.start_move()
    bench.controller.stop_now()
    bench.work(1)
    assert bench.has(MotionState.STOPPED)
    assert "not by this service: the controller was stopped by a command" in bench.drive.status.detail


def test_reference_that_moves_an_absolute_robot_is_a_fault(bench: Bench) -> None:
    bench.work()
    bench.drive.acknowledge_stop()
    bench.work()
    assert bench.drive.begin_reference("r1") is None
    bench.controller.reading = replace(bench.controller.reading, pose=PlatformPose(1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    bench.work(1)
    assert bench.has(MotionState.FAULT)
    assert "reference moved the robot by 1.000 mm" in bench.drive.status.detail


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
    assert seen[0].fresh_reading(bench.now_s) is not None
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
    assert bench.controller.reading.locked
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
    assert bench.controller.reading.locked
    assert bench.crashes == ["ZeroDivisionError: a bug"]


def test_a_controller_that_is_slow_at_rest_is_asked_again(bench: Bench) -> None:
    bench.make_ready()
    bench.controller.silent = True
    bench.now_s += 0.9
    bench.work(1)
    assert bench.has(MotionState.LOCKED)
    assert bench.drive.status.reading is None, "what is not known must not be told"
    bench.controller.silent = False
    bench.work(1)
    assert bench.drive.status.reading is not None


def test_a_controller_that_stays_silent_at_rest_is_a_fault(bench: Bench) -> None:
    bench.make_ready()
    bench.controller.silent = True
    bench.now_s += 1.1
    bench.work(1)
    assert bench.has(MotionState.FAULT)


def test_a_controller_that_is_silent_in_a_move_is_a_fault_at_once(bench: Bench) -> None:
    bench.start_move()
    bench.controller.silent = True
    bench.work(1)
    assert bench.has(MotionState.FAULT)
    assert bench.controller.stopped
