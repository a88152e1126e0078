"""The drive, one round of work at a time: from start to ready, moves and stops."""

import threading
import time
from dataclasses import replace

import pytest

from services.robot.core.guard import PermittedMove
from services.robot.core.refusals import RefusalCode
from services.robot.core.status import DriveStatus
from shared.geometry.hexapod import PlatformPose
from shared.robot_states import MotionState
from tests.unit.services.robot.drive_bench import MOVE, Bench


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
    assert bench.controller.feedback.locked
    assert bench.outcome == "reached"
    assert bench.drive.status.deviation is not None
    assert bench.drive.status.deviation.distance_mm == 0.0


@pytest.mark.requirement("ROB-13")
def test_the_outcome_is_not_told_before_the_lock_is_read_back(bench: Bench) -> None:
    bench.start_move()
    bench.controller.arrive()
    bench.work(1)
    assert bench.outcome == "moving"


@pytest.mark.requirement("ROB-13")
def test_a_move_that_ends_beside_its_target_is_a_fault(bench: Bench) -> None:
    bench.start_move()
    bench.controller.arrive(PlatformPose(1.94, 0.0, 0.0, 0.0, 0.0, 0.0))
    bench.work()
    assert bench.has(MotionState.FAULT)
    assert "0.060 mm and 0.000° from its target" in bench.drive.status.detail
    assert bench.outcome == "failed"
    assert bench.controller.feedback.locked


@pytest.mark.requirement("ROB-07")
def test_nothing_is_begun_without_a_guardian(bench: Bench) -> None:
    bench.make_ready()
    bench.guardian.reason = "the guardian process has ended"
    refusal = bench.begin_move()
    assert refusal is not None
    assert refusal.code is RefusalCode.GUARDIAN_MISSING
    assert refusal.message.startswith("the guardian process has ended; wait a second")
    bench.drive.stop("test")
    bench.controller.feedback = replace(bench.controller.feedback, referenced=False)
    bench.work()
    assert bench.drive.acknowledge_stop() is None
    bench.work()
    refusal = bench.drive.begin_reference("r2")
    assert refusal is not None
    assert refusal.code is RefusalCode.GUARDIAN_MISSING
    bench.guardian.reason = ""
    assert bench.drive.begin_reference("r3") is None


def test_a_stop_during_a_move_locks_at_once_and_the_position_is_known(bench: Bench) -> None:
    bench.start_move()
    bench.drive.stop("test")
    assert bench.has(MotionState.STOPPED)
    assert bench.controller.feedback.locked
    bench.work(1)
    assert bench.outcome == "stopped"
    assert bench.drive.status.fresh_feedback(bench.now_s) is not None
    assert len(bench.controller.motions) == 1


@pytest.mark.requirement("ROB-05")
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


def test_a_move_that_is_asked_for_while_the_worker_locks_is_not_taken_for_a_lost_one(bench: Bench) -> None:
    bench.make_ready()
    bench.drive.stop("test")
    bench.work()
    asked: list[object] = []

    def ask_for_a_move() -> None:
        bench.controller.before_lock = lambda: None
        asked.append(bench.begin_move())

    assert bench.drive.acknowledge_stop() is None
    bench.controller.before_lock = ask_for_a_move
    bench.work(1)
    assert asked == [None]
    bench.work(1)
    assert bench.has(MotionState.MOVING)
    assert bench.controller.feedback.unlocked


def test_a_reading_from_before_a_stop_says_nothing_about_the_time_after(bench: Bench) -> None:
    bench.start_move()
    bench.controller.after_read = lambda: bench.drive.stop("test")
    bench.work(1)
    bench.controller.after_read = lambda: None
    assert bench.has(MotionState.STOPPED)
    assert bench.drive.status.detail == "test"
    assert bench.drive.status.fresh_feedback(bench.now_s) is None
    bench.work(1)
    assert bench.has(MotionState.STOPPED)


def test_what_is_not_locked_yet_cannot_be_acknowledged(bench: Bench) -> None:
    bench.work()
    bench.drive.stop("once more")
    refusal = bench.drive.acknowledge_stop()
    assert refusal is not None
    assert refusal.code is RefusalCode.POSE_UNKNOWN, "no feedback since the last stop"
