"""Stop waits for nothing: not for a hanging command, a hanging query, or the record."""

import threading
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

from services.ui_api.core.events import EventKind
from services.ui_api.core.robot_event_data import StopRequested
from services.ui_api.handlers.commands import Asked
from services.ui_api.handlers.planning import MotionRequest
from shared.messages.robot import CommandReply, MotionState, StopLatch, StopReport
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import Room, wait_until

HANGING_REQUESTS = 60


def _wait_until_no_thread_is_free(room: Room) -> None:
    """Ask for something that needs a thread, until it has to wait for one."""
    for _ in range(HANGING_REQUESTS):
        try:
            room.client.get("/api/v1/cases", timeout=0.3)
        except httpx.TimeoutException:
            return
    pytest.fail("the server always had a thread to spare: the test would prove nothing")


@pytest.mark.requirement("GW-05")
def test_stop_needs_no_key_and_no_body_and_is_recorded(room: Room) -> None:
    answer = room.client.post("/api/v1/robot/stop")
    assert answer.status_code == 200
    assert answer.json() == {"confirmed": True, "state": "stopped", "detail": "", "recorded": True}
    assert len(room.robot.stops) == 1
    assert room.gateway.record.events_after(0)[-1].kind is EventKind.STOP_REQUESTED


def test_stop_during_a_motion_stops_the_operation(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    operation_id = room.post(f"/cases/{case_id}/motions", {"plan": plan}).json()["id"]
    room.wait_for_status(operation_id, "running")
    assert room.client.post("/api/v1/robot/stop").json()["confirmed"] is True
    ended = room.wait_for_status(operation_id, "stopped")
    assert (ended["began"], ended["code"]) == (True, "motion_stopped")
    assert room.get(f"/cases/{case_id}").json()["procedure"]["stage"] == "positioning"


def test_stop_does_not_wait_for_a_motion_command_that_hangs(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    room.robot.answers_moves = room.robot.hang
    operation_id = room.post(f"/cases/{case_id}/motions", {"plan": plan}).json()["id"]
    assert room.robot.moved.wait(PATIENCE_S)
    assert room.gateway.record.ledger.operations[operation_id].status == "requested"
    assert room.client.post("/api/v1/robot/stop").json()["confirmed"] is True
    assert room.robot.stopped.is_set()
    room.robot.release.set()


def test_stop_does_not_wait_for_the_threads_of_other_requests(room: Room) -> None:
    """More requests hang in queries than the server has threads for them."""
    hanging = [threading.Thread(target=room.post, args=("/robot/reset",)) for _ in range(HANGING_REQUESTS)]
    with room.gateway.record.write():  # each of them waits for its turn to be recorded
        for thread in hanging:
            thread.start()
        _wait_until_no_thread_is_free(room)
        assert room.client.post("/api/v1/robot/stop").json()["confirmed"] is True
        assert room.robot.stopped.is_set()
    for thread in hanging:
        thread.join(PATIENCE_S)


@pytest.mark.requirement("GW-05")
def test_stop_is_sent_while_the_record_is_locked(room: Room) -> None:
    answers: list[bool] = []

    def stop() -> None:
        answers.append(room.client.post("/api/v1/robot/stop").json()["recorded"])

    thread = threading.Thread(target=stop)
    with room.gateway.record.write():
        thread.start()
        assert room.robot.stopped.wait(PATIENCE_S), "the stop waited for the record"
        thread.join(PATIENCE_S)
    assert answers == [False]
    room.log.wait_for_event(lambda e: e.kind is EventKind.STOP_REQUESTED)


@pytest.mark.requirement("ROB-04")
def test_a_stop_that_is_not_confirmed_says_what_to_do(room: Room) -> None:
    room.router.cut()
    answer = room.client.post("/api/v1/robot/stop")
    assert (answer.status_code, answer.json()["code"]) == (504, "stop_not_confirmed")
    assert "press the stop button on the controller" in answer.json()["detail"]


@pytest.mark.parametrize(
    "report",
    [
        None,
        StopReport(written=False),
        StopReport(written=True),
        StopReport(written=True, standstill=False, locked=True),
        StopReport(written=True, standstill=True, locked=False),
    ],
)
def test_a_stop_is_confirmed_only_by_standstill_and_brakes(room: Room, report: StopReport | None) -> None:
    room.robot.answers_stops = CommandReply(
        command_id=None, verdict="accepted", message="what is known", state=MotionState.STOPPED, stop=report
    )
    answer = room.client.post("/api/v1/robot/stop")
    assert (answer.status_code, answer.json()["code"]) == (504, "stop_not_confirmed")
    assert answer.json()["detail"] == "what is known"
    recorded = room.gateway.record.events_after(0)[-1].data
    assert isinstance(recorded, StopRequested)
    assert (recorded.confirmed, recorded.message) == (False, "what is known")


def test_a_stop_between_the_recording_of_a_motion_and_its_sending_wins(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    with room.gateway.record.write() as unit:
        case = room.gateway.cases.case(case_id)
        operation = room.gateway.planning.begin_motion(
            unit, case, MotionRequest(plan, False, "Dr A"), room.gateway.commands.asked()
        )
        room.gateway.stops.stop("test")
    ended = room.wait_for_status(operation.requested.operation_id, "stopped")
    assert (ended["began"], ended["code"]) == (False, "stopped_before_sending")
    assert room.robot.moves == []


def test_acknowledging_a_stop_is_an_operation(room: Room) -> None:
    room.robot.say(MotionState.STOPPED, stop=StopLatch.LATCHED)
    answer = room.post("/robot/acknowledge-stop")
    assert answer.status_code == 202
    ended = room.wait_for_status(answer.json()["id"], "succeeded")
    assert ended["verb"] == "acknowledge_stop"
    assert room.robot.plain[0].verb == "acknowledge_stop"


@pytest.mark.requirement("GW-05")
@pytest.mark.parametrize("verb", ["acknowledge-stop", "reset"])
def test_who_acknowledges_knew_of_no_stop_that_came_after_he_asked(
    room: Room, verb: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = _latched(room, "somebody stopped it")
    came = _asked_for(room, monkeypatch)
    with ThreadPoolExecutor(1) as pool:
        with room.gateway.record.write():  # the request waits for its turn to be recorded
            waits = pool.submit(room.post, f"/robot/{verb}")
            assert came.wait(PATIENCE_S)
            later = _latched(room, "somebody stopped it again")
        room.wait_for_status(waits.result().json()["id"], "succeeded")
    assert known < later
    assert room.robot.plain[0].envelope.after_state_sequence == known


def test_a_motion_that_waits_for_the_record_is_not_sent_after_a_stop(
    room: Room, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    etag = room.etag_for(f"/cases/{case_id}")
    came = _asked_for(room, monkeypatch)
    with ThreadPoolExecutor(1) as pool:
        with room.gateway.record.write():
            waits = pool.submit(room.post, f"/cases/{case_id}/motions", {"plan": plan}, None, etag)
            assert came.wait(PATIENCE_S)
            room.gateway.stops.stop("test")
        ended = room.wait_for_status(waits.result().json()["id"], "stopped")
    assert (ended["began"], ended["code"]) == (False, "stopped_before_sending")
    assert room.robot.moves == []


def _asked_for(room: Room, monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Set when the next request has come, and what was known then was noted."""
    came, asked = threading.Event(), room.gateway.commands.asked

    def noted() -> Asked:
        known = asked()
        came.set()
        return known

    monkeypatch.setattr(room.gateway.commands, "asked", noted)
    return came


def _latched(room: Room, detail: str) -> int:
    """The robot is stopped, and the gateway knows it; the number of that state."""
    said = room.robot.say(MotionState.STOPPED, stop=StopLatch.LATCHED, detail=detail)
    wait_until(lambda: (seen := room.gateway.view.newest()) is not None and seen.state.sequence == said.sequence)
    return said.sequence


@pytest.mark.parametrize("verb", ["reference", "reset"])
def test_other_commands_reach_the_robot_once(room: Room, verb: str) -> None:
    room.unreference()
    for _ in range(2):
        answer = room.post(f"/robot/{verb}", key="the-same")
        assert answer.status_code == 202
    assert answer.json()["verb"] == verb
    operation_id = answer.json()["id"]
    room.wait_for_status(operation_id, "running", "succeeded")
    assert [c.envelope.command_id for c in room.robot.plain] == [operation_id]


def test_referencing_ends_when_the_robot_says_so(room: Room) -> None:
    room.unreference()
    operation_id = room.post("/robot/reference").json()["id"]
    room.wait_for_status(operation_id, "running")
    room.robot.say(MotionState.REFERENCING, command_id=operation_id, outcome="moving")
    room.robot.say(MotionState.LOCKED, command_id=operation_id, outcome="reached")
    assert room.wait_for_status(operation_id, "succeeded")["began"] is True
