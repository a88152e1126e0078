"""What was acknowledged and is not there any more is found."""

import sqlite3
from contextlib import closing
from pathlib import Path

from benchmarks.faults.acknowledged import Acknowledged
from distalock.client import RequestRefused
from distalock.rest_client import JsonObject, RestClient


class Shelf(RestClient):
    """A gateway that knows these resources and no others."""

    def __init__(self, resources: dict[str, JsonObject]) -> None:
        super().__init__("http://127.0.0.1:1")
        self._resources = resources

    def get(self, path: str) -> JsonObject:
        if path not in self._resources:
            raise RequestRefused.of(404, "plan_not_found", f"there is no {path}")
        return self._resources[path]


PLAN = "/api/v1/cases/c/plans"


def test_an_answer_is_kept_as_long_as_its_effect_is_there() -> None:
    acknowledged = Acknowledged([(PLAN, {"number": 1, "sha256": "aa"}), (f"{PLAN}/1/approval", {})])
    with Shelf({f"{PLAN}/1": {"sha256": "aa", "approval": {"plan": 1}}}) as shelf:
        assert acknowledged.lost_answers(shelf) == []
    with Shelf({f"{PLAN}/1": {"sha256": "aa", "approval": None}}) as shelf:
        assert acknowledged.lost_answers(shelf) == [f"{PLAN}/1/approval"]
    with Shelf({f"{PLAN}/1": {"sha256": "bb", "approval": {"plan": 1}}}) as shelf:
        assert acknowledged.lost_answers(shelf) == [PLAN]
    with Shelf({}) as shelf:
        assert acknowledged.lost_answers(shelf) == [PLAN, f"{PLAN}/1/approval"]


def test_images_and_steps_are_looked_for_in_the_record(tmp_path: Path) -> None:
    record = tmp_path / "record.sqlite"
    with closing(sqlite3.connect(record)) as connection, connection:
        connection.execute("CREATE TABLE events (kind TEXT, data_json TEXT)")
        rows = [("image_received", '{"sop_instance_uid": "1.2.3"}'), ("step_recorded", "{}")]
        connection.executemany("INSERT INTO events VALUES (?, ?)", rows)
    steps: list[tuple[str, JsonObject]] = [("/api/v1/cases/c/steps", {})]
    assert Acknowledged(list(steps), ["1.2.3"]).images_not_on_record(record) == []
    assert Acknowledged(list(steps), ["1.2.3", "1.2.4"]).images_not_on_record(record) == ["1.2.4"]
    assert Acknowledged(list(steps)).steps_lost(record) == 0
    assert Acknowledged(2 * list(steps)).steps_lost(record) == 1
