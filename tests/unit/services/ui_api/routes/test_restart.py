"""What a gateway knows after it was ended and started again."""

import queue
from pathlib import Path

import pytest

from services.ui_api.core.chain import ChainIntact
from services.ui_api.record.database import existing_database, sqlite_url
from services.ui_api.record.verify import verify_record
from shared.bus.keys import Keys
from shared.bus.port import Sample
from shared.errors import ConfigurationError
from shared.messages.base import decode
from shared.messages.cases import CaseContext
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import ROOM, open_room


def test_the_open_case_is_taken_up_and_told_on_the_bus(tmp_path: Path) -> None:
    with open_room(tmp_path) as room:
        first = room.post("/cases", samples.case_body(), key="opened")
        case_id = first.json()["id"]
        plan = room.approved_plan(case_id)
    heard: queue.Queue[CaseContext] = queue.Queue()

    def hear(sample: Sample) -> None:
        heard.put(decode(CaseContext, sample.payload))

    with open_room(tmp_path) as room:
        room.imaging.bus.subscribe_retained(Keys(ROOM).case_context, hear)
        assert heard.get(timeout=PATIENCE_S).case_id == case_id
        again = room.post("/cases", samples.case_body(), key="opened")
        assert again.text == first.text, "an answer outlives the process that gave it"
        assert room.get(f"/cases/{case_id}/plans/{plan}").json()["approval"]["approved_by"] == "demo"
        assert room.get(f"/cases/{case_id}").json()["procedure"]["aim"] == "approved"
    assert isinstance(verify_record(existing_database(sqlite_url(tmp_path))), ChainIntact)


@pytest.mark.requirement("GW-10")
def test_a_motion_under_way_when_the_gateway_ended_is_followed_and_not_sent_again(tmp_path: Path) -> None:
    with open_room(tmp_path) as room:
        plan = room.approved_plan(case_id := room.open_case())
        operation_id = room.post(f"/cases/{case_id}/motions", {"plan": plan}, key="moved").json()["id"]
        room.wait_for_status(operation_id, "running")
        last = room.robot.state
    with open_room(tmp_path) as room:
        room.robot.state = last
        room.robot.arrive()
        ended = room.wait_for_status(operation_id, "succeeded")
        assert ended["deviation_mm"] == 0.01
        repeated = room.post(f"/cases/{case_id}/motions", {"plan": plan}, key="moved")
        assert repeated.json()["id"] == operation_id
        assert room.robot.moves == []


def test_a_second_gateway_on_the_same_record_does_not_start(tmp_path: Path) -> None:
    with open_room(tmp_path) as room:
        with pytest.raises(ConfigurationError, match="is held by another gateway that runs now"), open_room(tmp_path):
            pytest.fail("two gateways have the same record open")
        assert room.post("/cases", samples.case_body()).status_code == 201
    with open_room(tmp_path) as room:
        assert room.get("/cases").json()["items"] != []


def test_a_folder_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with (
        pytest.raises(ConfigurationError, match=r"its folder cannot be written: .*; set another state_dir"),
        open_room(tmp_path / "file" / "state"),
    ):
        pytest.fail("a record in no folder")
