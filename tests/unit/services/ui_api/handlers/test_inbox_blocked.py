"""While the record takes nothing, what comes in waits."""

import sqlite3
from pathlib import Path

import pytest

from shared.messages.robot import CommandReply, MotionState, MoveCommand
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import open_room, wait_until


def test_an_image_that_arrives_while_the_record_is_locked_is_recorded_afterwards(tmp_path: Path) -> None:
    with open_room(tmp_path) as room:
        case_id = room.open_case()
        holder = sqlite3.connect(tmp_path / "case-record.sqlite", isolation_level=None)
        holder.execute("BEGIN IMMEDIATE")
        header = room.imaging.send("image", case_id)
        wait_until(lambda: room.gateway.inbox.blocked is not None)
        assert "database is locked" in str(room.gateway.inbox.blocked)
        assert room.client.get("/readyz").status_code == 503
        holder.close()
        ledger = room.gateway.record.ledger
        room.log.wait_for(lambda: ledger.cases[case_id].image(header.sha256) is not None)
        wait_until(lambda: room.gateway.inbox.blocked is None)


def test_a_command_whose_outcome_cannot_be_recorded_is_settled_by_the_robots_state(tmp_path: Path) -> None:
    with open_room(tmp_path) as room:
        case_id = room.open_case()
        plan = room.approved_plan(case_id)
        file = tmp_path / "case-record.sqlite"
        holder = sqlite3.connect(file, isolation_level=None, check_same_thread=False)

        def hold_the_record(command: MoveCommand) -> CommandReply:
            holder.execute("BEGIN IMMEDIATE")
            return room.robot.hang(command)

        room.robot.answers_moves = hold_the_record
        room.robot.release.set()
        begun = room.post(f"/cases/{case_id}/motions", {"plan": plan}).json()
        assert room.robot.moved.wait(PATIENCE_S)
        wait_until(lambda: room.gateway.inbox.blocked is not None)
        room.robot.arrive()
        holder.close()
        room.wait_for_status(str(begun["id"]), "succeeded")


def test_whoever_acts_writes_before_frames_that_have_come(tmp_path: Path) -> None:
    with open_room(tmp_path) as room:
        case_id = room.open_case()
        ledger, units = room.gateway.record.ledger, list[float]()
        wait_until(lambda: room.gateway.acting.count == 0)  # a request ends a moment after its answer
        room.gateway.record.on_write = units.append
        now_s = [100.0]
        room.gateway.acting._clock_s = lambda: now_s[0]
        with room.gateway.acting.acting():
            now_s[0] = 0.0  # his moment is not over for 100 s
            headers = [room.imaging.send(f"image {k}", case_id) for k in range(10)]
            wait_until(lambda: room.gateway.acting.waiting == 1)
        room.log.wait_for(lambda: all(ledger.cases[case_id].image(header.sha256) is not None for header in headers))
        assert len(units) < len(headers)


def test_frames_that_had_to_wait_are_recorded_together(tmp_path: Path) -> None:
    """Behind a slow disk frames come faster than they go one by one: the inbox would fill, and an X-ray wait behind."""
    with open_room(tmp_path) as room:
        case_id = room.open_case()
        holder = sqlite3.connect(tmp_path / "case-record.sqlite", isolation_level=None)
        holder.execute("BEGIN IMMEDIATE")
        first = room.imaging.send("image 0", case_id)
        wait_until(lambda: room.gateway.inbox.blocked is not None)
        headers = [first, *(room.imaging.send(f"image {k}", case_id) for k in range(1, 40))]
        room.imaging.publish(headers[7])  # one that comes twice
        units: list[float] = []
        room.gateway.record.on_write = units.append
        holder.close()
        ledger = room.gateway.record.ledger
        room.log.wait_for(lambda: ledger.cases[case_id].image(headers[-1].sha256) is not None)
        assert [image.image_sha256 for image in ledger.cases[case_id].images] == [one.sha256 for one in headers]
        assert len(units) < 10


def test_a_fault_that_found_no_place_is_recorded_with_a_later_state(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_room(tmp_path) as room:
        inbox, ledger = room.gateway.inbox, room.gateway.record.ledger
        monkeypatch.setattr(inbox._queue, "put", lambda _: False)
        room.robot.say(MotionState.FAULT)
        wait_until(lambda: (seen := room.gateway.view.newest()) is not None and seen.state.state is MotionState.FAULT)
        monkeypatch.undo()
        head = ledger.head_sequence
        room.robot.say(MotionState.FAULT)  # nothing of its condition has changed
        room.log.wait_for_event(lambda e: e.sequence > head and getattr(e.data, "state", "") == "fault")
        assert ledger.robot.unwatched == "the robot was in fault since it was taken"
