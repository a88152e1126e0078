"""The log as a stream: complete, in order, resumable, and ended with the gateway."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice

import httpx
import pytest

from services.ui_api.routes.event_followers import RETRY_MS
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import Room


def _events(answer: httpx.Response) -> Iterator[dict[str, object]]:
    """The events of a stream as they come."""
    for line in answer.iter_lines():
        if line.startswith("data: "):
            yield json.loads(line.removeprefix("data: "))


def _up_to(events: Iterator[dict[str, object]], kind: str) -> Iterator[dict[str, object]]:
    for event in events:
        yield event
        if event["kind"] == kind:
            return


@contextmanager
def _stream(room: Room, path: str, last_event_id: int | None = None) -> Iterator[Iterator[dict[str, object]]]:
    headers = {} if last_event_id is None else {"Last-Event-ID": str(last_event_id)}
    with room.client.stream("GET", f"/api/v1{path}", headers=headers, timeout=PATIENCE_S) as answer:
        assert answer.status_code == 200
        assert answer.headers["content-type"].startswith("text/event-stream")
        yield _events(answer)


def test_a_case_is_streamed_from_its_beginning_and_goes_on_live(room: Room) -> None:
    case_id = room.open_case()
    with _stream(room, f"/cases/{case_id}/events") as events:
        first = next(events)
        assert (first["kind"], first["case_id"]) == ("case_opened", case_id)
        room.imaging.send("image", case_id)
        later = [int(str(e["sequence"])) for e in _up_to(events, "image_received")]
    assert later == [e.sequence for e in room.gateway.record.events_after(0, case_id)[1 : 1 + len(later)]]


def test_a_stream_resumes_after_the_last_event_received(room: Room) -> None:
    case_id = room.open_case()
    room.post(f"/cases/{case_id}/steps", {"step": "mount_moved"})
    known = room.gateway.record.events_after(0)
    with _stream(room, "/events", last_event_id=2) as events:
        resumed = [e["sequence"] for e in islice(events, len(known) - 2)]
    assert resumed == [e.sequence for e in known[2:]]
    with _stream(room, "/events?after=3") as events:
        assert next(events)["sequence"] == 4


def test_without_a_place_to_resume_only_new_events_come(room: Room) -> None:
    head = room.gateway.record.ledger.head_sequence
    with _stream(room, "/events") as events:
        case_id = room.open_case()
        came = [next(events)]
        while came[-1]["case_id"] is None:  # what the room recorded of its robot may be new as well
            came.append(next(events))
    assert came[-1]["case_id"] == case_id
    assert int(str(came[0]["sequence"])) > head


@pytest.mark.parametrize("place", ["/events", "/events?after={}", "/cases/{case_id}/events"])
def test_a_place_beyond_the_end_of_the_log_is_its_end(room: Room, place: str) -> None:
    case_id = room.open_case()
    beyond = room.gateway.record.ledger.head_sequence + 50  # of before an older backup was restored
    headers = {} if "after" in place else {"Last-Event-ID": str(beyond)}
    path = f"/api/v1{place.format(beyond, case_id=case_id)}"
    with room.client.stream("GET", path, headers=headers, timeout=PATIENCE_S) as answer:
        step = room.post(f"/cases/{case_id}/steps", {"step": "mount_moved"})
        assert step.status_code == 201, step.text
        lines = (line for line in answer.iter_lines() if line.startswith(("data: ", ":")))
        first = next((line for line in islice(lines, 4) if line.startswith("data: ")), None)  # a ping may come before
    assert first is not None, "nothing but pings came"
    came = json.loads(first.removeprefix("data: "))
    assert (came["kind"], came["case_id"]) == ("step_recorded", case_id)
    assert came["sequence"] < beyond


def test_changes_of_the_robot_are_events(room: Room) -> None:
    with _stream(room, "/events?after=0") as events:
        changed = next(e for e in events if e["kind"] == "robot_changed")
    assert changed["data"]["state"] == "locked"  # type: ignore[index]


def test_streams_end_when_the_gateway_closes_and_say_when_to_come_again(room: Room) -> None:
    ended, lines = threading.Event(), list[str]()

    def read_to_the_end() -> None:
        with room.client.stream("GET", "/api/v1/events?after=0", timeout=PATIENCE_S) as answer:
            for line in answer.iter_lines():
                lines.append(line)
                started.set()
        ended.set()

    started = threading.Event()
    reader = threading.Thread(target=read_to_the_end)
    reader.start()
    assert started.wait(PATIENCE_S)
    room.gateway.feed.close()
    assert ended.wait(PATIENCE_S)
    reader.join()
    assert f"retry: {RETRY_MS}" in lines[-4:], lines[-4:]


def test_a_place_that_is_no_number_is_refused(room: Room) -> None:
    answer = room.client.get("/api/v1/events", headers={"Last-Event-ID": "last"})
    assert (answer.status_code, answer.json()["code"]) == (422, "request_invalid")
    assert room.get("/cases/none/events").json()["code"] == "case_not_found"
