"""Races go on where a run ended, over an odd race, and past the end of a session."""

import time
from pathlib import Path
from threading import Barrier

import httpx
import pytest
from pydantic import TypeAdapter

from benchmarks.common.runner import RowFile
from benchmarks.gateway.race_page import page_of
from benchmarks.gateway.race_room import NoPlan
from benchmarks.gateway.race_rows import AnswerRow, RaceRow, RecordTail
from benchmarks.gateway.races import Races, run_numbers
from benchmarks.gateway.surgeons import Surgeon, Turn
from services.ui_api.core.events import EventDraft
from services.ui_api.core.robot_event_data import StopRequested
from tests.unit.services.ui_api.room import open_room

ROW = RaceRow(7, "stand_in", (AnswerRow("anna", "stop", 200, ""),), 1, 1, (), 0.75)


class OddRaces(Races):
    """Races of which some have no plan."""

    def __init__(self, odd: set[int]) -> None:
        self._odd = odd

    def run(self, number: int) -> RaceRow:
        """A row, or none."""
        if number in self._odd:
            raise NoPlan("no plan after 5 attempts")
        return ROW


def test_an_odd_race_is_left_for_another_run() -> None:
    rows = list(run_numbers(OddRaces({1, 2}), range(4), time.monotonic() + 60.0))
    assert len(rows) == 2


def test_a_room_that_has_no_plan_any_more_ends_the_run() -> None:
    with pytest.raises(NoPlan, match="no plan after"):
        list(run_numbers(OddRaces({1, 2, 3}), range(6), time.monotonic() + 60.0))


def test_a_row_comes_back_from_its_file(tmp_path: Path) -> None:
    store = RowFile(tmp_path / "rows.jsonl", TypeAdapter(RaceRow))
    store.append("1 stand_in 7", ROW, "abc")
    assert store.read() == {"1 stand_in 7": ROW}


def test_the_page_counts_by_where_plans_come_from() -> None:
    page = page_of([ROW, RaceRow(8, "images", (), 0, 0, ("a motion went to the controller after a stop",), 4.0)], 1)
    assert "| offered | 1 | 1 | 1 | 1 | 0.8 s | 0 (limit 0) |" in page
    assert "| from images | 1 | 0 | 0 | 0 | 4.0 s | 1 (limit 0) |" in page
    assert "- race 8: a motion went to the controller after a stop" in page


def test_a_surgeon_whose_access_ends_renews_it_and_asks_again_under_the_same_key() -> None:
    asked: list[tuple[str, str, str]] = []

    def answer(request: httpx.Request) -> httpx.Response:
        token, key = request.headers.get("Authorization", ""), request.headers.get("Idempotency-Key", "")
        asked.append((request.url.path.rpartition("/")[2], token, key))
        if request.url.path.endswith("/refresh"):
            return httpx.Response(200, json={"access_token": "new", "refresh_token": "r2"})
        if token != "Bearer new":
            return httpx.Response(401, json={"code": "token_expired", "detail": "sign in"})
        return httpx.Response(201, json={})

    http = httpx.Client(base_url="http://gateway", transport=httpx.MockTransport(answer))
    surgeon = Surgeon("anna", http, "case-1", "r1")
    surgeon.play([Turn(0.0, "approve", twice=False)], 1, '"etag"', Barrier(1))
    assert [what for what, _, _ in asked] == ["approval", "refresh", "approval"]
    assert asked[0][2] == asked[2][2] != ""
    assert [one.status for one in surgeon.answers] == [201]
    assert surgeon.refresh_token == "r2"


def test_only_what_came_since_belongs_to_a_race(tmp_path: Path) -> None:
    with open_room(tmp_path) as room:
        record = room.gateway.record
        tail = RecordTail(record.folder or Path())

        def stop() -> None:
            with record.write() as unit:
                unit.append(EventDraft(StopRequested("somebody asked", True, ""), None, "anna"))

        stop()
        assert [one.kind for one in tail.events()] == ["stop_requested"]
        tail.pass_over()
        assert tail.events() == []
        stop()
        assert [one.kind for one in tail.events()] == ["stop_requested"]
        assert tail.chain_faults() == []
