"""The robot service on an in-memory bus: stops, silence of others, and faults."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from shared.geometry.hexapod import PlatformPose
from shared.messages.base import encode
from shared.messages.presence import ServiceName
from shared.messages.robot import (
    MotionState,
    PlainCommand,
    StopButton,
    StopCommand,
    StopLatch,
    StopReport,
)
from tests.unit.services.robot.fake_controller import BUTTON_PRESSED
from tests.unit.services.robot.room import KEYS, Room, wait_for

STOP = encode(StopCommand(client="console"))


@pytest.mark.requirement("ROB-03")
def test_a_stop_during_a_move_locks_within_a_fifth_of_a_second(room: Room) -> None:
    room.begin_move()
    asked_s = time.monotonic()
    reply = room.ask("stop", encode(StopCommand(client="console", reason="pressed")))
    locked_s = time.monotonic() - asked_s
    assert room.controller.feedback.locked
    assert locked_s < 0.2
    assert (reply.verdict, reply.state) == ("accepted", MotionState.STOPPED)
    state = room.wait(lambda s: s.state is MotionState.STOPPED and s.locked and s.pose is not None)
    assert state.outcome == "stopped"
    assert state.detail == "'console' asked for a stop: pressed"


@pytest.mark.requirement("ROB-02")
def test_a_stop_that_cannot_be_read_stops_all_the_same(room: Room) -> None:
    room.begin_move()
    assert room.ask("stop", b"\xff\x00").verdict == "accepted"
    assert room.controller.feedback.locked


@pytest.mark.requirement("ROB-04")
def test_a_stop_is_confirmed_by_what_the_controller_shows_after_it(room: Room) -> None:
    room.begin_move()
    reply = room.ask("stop", STOP)
    assert reply.stop == StopReport(written=True, standstill=True, locked=True)
    assert reply.stop.confirmed
    assert reply.message == ""


@pytest.mark.requirement("ROB-04")
def test_a_stop_of_a_controller_that_is_silent_is_not_confirmed(room: Room) -> None:
    room.begin_move()
    room.controller.silent = True
    reply = room.ask("stop", STOP)
    assert reply.stop == StopReport(written=True, standstill=None, locked=None)
    assert "has not shown since that the robot is at rest and locked; press the stop button" in reply.message


def test_a_stop_that_the_line_did_not_take_is_answered_at_once(room: Room) -> None:
    room.begin_move()
    room.controller.line_broken = "the line is cut"
    reply = room.ask("stop", STOP)
    assert reply.stop is not None
    assert not reply.stop.written
    assert reply.message.startswith("the stop was not written (the line is cut); ")
    assert "press the stop button on the controller" in reply.message


def test_a_stop_without_a_controller_says_so(room: Room) -> None:
    room.wait(lambda s: s.state is MotionState.STOPPED and s.locked)
    room.service._drive._motion.disconnected()
    reply = room.ask("stop", STOP)
    assert reply.stop == StopReport(written=False, standstill=None, locked=None)
    assert "the stop was not written (the controller is not connected)" in reply.message


def test_a_brake_that_does_not_hold_is_said_in_the_answer_to_a_stop(room: Room) -> None:
    room.begin_move()
    room.controller.brakes_hold = False
    reply = room.ask("stop", STOP)
    assert reply.stop == StopReport(written=True, standstill=True, locked=False)
    assert "at rest and is not locked" in reply.message
    assert "the robot does not lock" in reply.message


def test_stops_that_wait_for_their_confirmation_keep_no_other_stop_waiting(room: Room) -> None:
    room.begin_move()
    room.controller.silent = True
    room.controller.stops_taken.clear()
    with ThreadPoolExecutor(8) as askers:
        answers = [askers.submit(room.ask, "stop", STOP) for _ in range(8)]
        wait_for(lambda: len(room.controller.stops_taken) >= 8)
        assert not any(answer.done() for answer in answers), "all eight are out before the first is answered"
        room.controller.silent = False
        reports = [answer.result().stop for answer in answers]
    assert all(report is not None and report.confirmed for report in reports)


@pytest.mark.requirement("ROB-03")
def test_a_stop_waits_for_no_other_command(room: Room) -> None:
    room.begin_move()
    # As if another command were being decided on and never ended.
    with room.service._lock:
        reply = room.ask("stop", encode(StopCommand(client="console")))
    assert reply.verdict == "accepted"
    assert room.controller.feedback.locked


@pytest.mark.requirement("ROB-06")
def test_a_gateway_that_falls_silent_stops_the_move(room: Room) -> None:
    room.begin_move()
    room.clock_offset_s += 1.1
    state = room.wait(lambda s: s.state is MotionState.STOPPED)
    assert "the gateway was silent for" in state.detail
    assert room.controller.feedback.locked


def test_a_gateway_that_restarts_stops_the_move(room: Room) -> None:
    room.begin_move()
    room.heartbeat("gateway2")
    assert "restarted" in room.wait(lambda s: s.state is MotionState.STOPPED).detail


def test_a_gateway_whose_token_vanishes_stops_the_move(room: Room) -> None:
    token = room.bus.declare_alive(KEYS.alive("ui_api"))
    room.begin_move()
    token.close()
    assert "token vanished" in room.wait(lambda s: s.state is MotionState.STOPPED).detail


@pytest.mark.requirement("ROB-06")
@pytest.mark.parametrize("service", ["imaging", "registration"])
def test_a_service_that_falls_silent_in_motion_stops_it(room: Room, service: ServiceName) -> None:
    beats = room.bus.publisher(KEYS.heartbeat(service))
    ended = threading.Event()

    def beat() -> None:
        while not ended.wait(0.02):
            beats.put(b"")
            room.heartbeat()

    beating = threading.Thread(target=beat)
    beating.start()
    room.begin_move()
    room.let_states_pass()
    assert room.state.state is MotionState.MOVING
    ended.set()
    beating.join()
    state = room.wait(lambda s: s.state is MotionState.STOPPED)
    assert state.detail == f"{service} was silent for more than 0.4 s; see to it and acknowledge"


@pytest.mark.parametrize("service", ["imaging", "registration"])
def test_a_service_whose_token_vanishes_in_motion_stops_it(room: Room, service: ServiceName) -> None:
    token = room.bus.declare_alive(KEYS.alive(service))
    room.begin_move()
    token.close()
    assert f"{service} has gone" in room.wait(lambda s: s.state is MotionState.STOPPED).detail


@pytest.mark.requirement("ROB-06")
def test_what_started_the_service_is_missed_in_motion_when_it_hangs(room: Room) -> None:
    heard_s = [time.monotonic()]
    room.service.watch._others._silent_for_s["what started it"] = lambda: time.monotonic() - heard_s[0]
    ended = threading.Event()

    def hear() -> None:
        while not ended.wait(0.02):
            heard_s[0] = time.monotonic()
            room.heartbeat()

    hearing = threading.Thread(target=hear)
    hearing.start()
    room.begin_move()
    room.let_states_pass()
    ended.set()
    hearing.join()
    assert "what started it was silent" in room.wait(lambda s: s.state is MotionState.STOPPED).detail


def test_a_service_that_was_not_there_when_the_motion_began_is_not_missed(room: Room) -> None:
    others = room.service.watch._others
    room.begin_move()
    wait_for(lambda: others._present is not None)
    room.bus.publisher(KEYS.heartbeat("imaging")).put(b"")
    wait_for(lambda: others._silent_for_s["imaging"]() < float("inf"))
    room.clock_offset_s += 0.5  # longer than what would be missed, shorter than the gateway's silence that ends it here
    room.heartbeat()
    room.let_states_pass()
    assert room.state.state is MotionState.MOVING


def test_repeated_heartbeats_are_no_sign_of_life(room: Room) -> None:
    room.begin_move()
    for _ in range(100):
        room.heartbeats -= 1
        room.heartbeat()
        time.sleep(0.01)  # as a bus would repeat one, while the robot's clock runs six times as fast
        room.clock_offset_s += 0.05
        if room.state.state is MotionState.STOPPED:
            break
    else:
        pytest.fail("the same heartbeat over and over kept the robot moving for six seconds")
    assert "silent" in room.state.detail


@pytest.mark.requirement("ROB-06")
def test_a_lost_router_stops_the_move(room: Room) -> None:
    room.begin_move()
    room.router.cut()
    wait_for(lambda: room.controller.stopped)
    assert room.controller.feedback.locked
    room.router.restore()
    state = room.wait(lambda s: s.state is MotionState.STOPPED)
    assert "link to the router was lost" in state.detail or "token vanished" in state.detail


def test_a_silent_controller_is_a_fault_that_a_person_resets(room: Room) -> None:
    room.make_ready()
    room.controller.failures = ["the hexapod controller is silent"]
    state = room.wait(lambda s: s.state is MotionState.FAULT)
    assert "silent" in state.detail
    reply = room.ask("reset", encode(PlainCommand(verb="reset", envelope=room.envelope())))
    assert reply.verdict == "accepted"
    room.wait(lambda s: s.state is MotionState.STOPPED)


def test_a_plan_from_before_a_reconnection_is_refused(room: Room) -> None:
    plan_json = room.ready_with_plan()
    room.begin_epoch("reg.2")
    assert room.until_known(plan_json).code == "plan_stale", "the robot has heard of it, and did not begin it"
    room.controller.failures = ["the hexapod controller is silent"]
    room.wait(lambda s: s.state is MotionState.FAULT)
    room.ask("reset", encode(PlainCommand(verb="reset", envelope=room.envelope())))
    room.wait(lambda s: s.state is MotionState.STOPPED and s.locked)
    room.acknowledge()
    room.wait(lambda s: s.state is MotionState.LOCKED and s.locked)
    room.begin_epoch("reg.1")
    assert room.until_known(plan_json).code == "plan_before_reconnection"
    assert room.until_known(room.publish_plan(shift_mm=2.0)).verdict == "accepted"


def test_leaving_during_a_move_locks() -> None:
    room = Room()
    with room.service:
        room.begin_move()
    assert room.controller.feedback.locked
    assert room.controller.closed
    assert room.wait(lambda s: s.state is MotionState.DISCONNECTED).stop is StopLatch.LATCHED


def test_it_does_not_move_what_it_found_elsewhere(room: Room) -> None:
    room.ready_with_plan()
    room.ask("stop", encode(StopCommand(client="gateway")))
    room.wait(lambda s: s.state is MotionState.STOPPED and s.locked)
    elsewhere = PlatformPose(0.1, 0.0, 0.0, 0.0, 0.0, 0.0)
    room.controller.feedback = replace(room.controller.feedback, pose=elsewhere)
    room.wait(lambda s: s.state is MotionState.FAULT)  # it has shifted; somebody looks, and resets it there
    assert room.ask("reset", encode(PlainCommand(verb="reset", envelope=room.envelope()))).verdict == "accepted"
    room.wait(lambda s: s.state is MotionState.STOPPED and s.locked and s.pose is not None and s.pose.x_mm == 0.1)
    assert room.acknowledge().verdict == "accepted"
    room.wait(lambda s: s.state is MotionState.LOCKED and s.locked)
    assert room.until_known(room.publish_plan(shift_mm=2.0)).code == "start_pose_differs"


@pytest.mark.requirement("ROB-12")
def test_a_locked_robot_that_shifts_is_a_fault(room: Room) -> None:
    room.ready_with_plan()
    room.controller.feedback = replace(room.controller.feedback, pose=PlatformPose(0.0, 0.0, -0.3, 0.0, 0.0, 0.0))
    state = room.wait(lambda s: s.state is MotionState.FAULT)
    assert "the locked robot has moved by 0.300 mm" in state.detail


@pytest.mark.requirement("ROB-12")
@pytest.mark.parametrize("acknowledged", [False, True])
def test_a_robot_that_shifts_while_a_stop_is_in_force_is_a_fault(room: Room, acknowledged: bool) -> None:  # noqa: FBT001 - a case of the test
    room.ready_with_plan()
    room.wait(lambda s: s.state is MotionState.LOCKED and s.pose is not None)
    room.ask("stop", STOP)
    room.wait(lambda s: s.state is MotionState.STOPPED and s.locked)
    if acknowledged:
        assert room.acknowledge().verdict == "accepted"
        room.wait(lambda s: s.state is MotionState.LOCKED)
    room.controller.feedback = replace(room.controller.feedback, pose=PlatformPose(0.0, 0.0, -0.3, 0.0, 0.0, 0.0))
    state = room.wait(lambda s: s.state is MotionState.FAULT)
    assert "the locked robot has moved by 0.300 mm" in state.detail


def test_a_stop_button_goes_through_its_states(room: Room) -> None:
    room.make_ready()
    room.wait(lambda s: s.stop_button is StopButton.CLEAR)
    room.controller.button_error = BUTTON_PRESSED
    state = room.wait(lambda s: s.state is MotionState.STOPPED and s.locked)
    assert (state.stop_button, state.stop) == (StopButton.PRESSED, StopLatch.LATCHED)
    assert room.acknowledge().code == "stop_button_pressed"
    room.controller.button_error = None
    room.wait(lambda s: s.stop_button is StopButton.RELEASED and s.locked)
    assert room.acknowledge().verdict == "accepted"
    room.wait(lambda s: s.stop_button is StopButton.CLEAR and s.state is MotionState.LOCKED)


@pytest.mark.requirement("ROB-05")
def test_an_acknowledgement_that_was_under_way_when_a_stop_came_releases_nothing(room: Room) -> None:
    room.make_ready()
    room.ask("stop", STOP)
    room.wait(lambda s: s.state is MotionState.STOPPED and s.locked)
    under_way = encode(PlainCommand(verb="acknowledge_stop", envelope=room.envelope()))
    room.ask("stop", STOP)
    reply = room.ask("acknowledge_stop", under_way)
    assert (reply.verdict, reply.code) == ("refused", "stopped_since")
    room.let_states_pass()
    assert room.acknowledge().verdict == "accepted"
