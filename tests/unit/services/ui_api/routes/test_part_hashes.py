"""One hash of each part over REST: catalogue, case, record and robot; and a refusal where robot and case differ."""

import json
from dataclasses import replace

from shared.parts.catalogue import catalogue_entry
from shared.parts.files import sha256_of
from shared.parts.hexapod_file import hexapod_from_json
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.room import Room
from tests.unit.shared.parts.test_canonical import written_otherwise


def hexapod_file() -> bytes:
    entry = catalogue_entry("hexapod-h70")
    assert entry is not None
    return entry.content


def taller() -> dict[str, object]:
    """Another hexapod."""
    file: dict[str, object] = json.loads(hexapod_file())
    return file | {"name": "taller", "zero_height_mm": float(str(file["zero_height_mm"])) + 0.5}


def test_catalogue_case_record_and_robot_give_the_same_hash_of_the_hexapod(room: Room) -> None:
    listed = {part["name"]: part["sha256"] for part in room.get("/parts").json()}["hexapod-h70"]
    assert sha256_of(room.get("/parts/hexapod-h70").content) == listed
    case_id = room.open_case()
    case = room.get(f"/cases/{case_id}").json()
    assert case["hexapod"]["sha256"] == listed
    assert sha256_of(room.get(f"/cases/{case_id}/parts/hexapod").content) == listed
    assert room.gateway.record.document(listed) == room.get("/parts/hexapod-h70").content
    assert hexapod_from_json(hexapod_file()).sha256 == listed
    assert room.get("/robot").json()["state"]["hexapod_sha256"] == listed


def test_a_file_that_is_written_otherwise_is_the_same_part(room: Room) -> None:
    named = room.get(f"/cases/{room.open_case()}").json()
    own = json.loads(written_otherwise(hexapod_file()))
    answer = room.patch(f"/cases/{named['id']}", {"hexapod": own})
    assert answer.status_code == 200
    assert answer.json()["hexapod"]["sha256"] == named["hexapod"]["sha256"]


def test_no_plan_with_another_hexapod_than_the_robots(room: Room) -> None:
    opened = room.post("/cases", samples.case_body(hexapod=taller()))
    assert opened.status_code == 201, opened.text
    case_id = opened.json()["id"]
    room.image("first", case_id)
    case = room.get(f"/cases/{case_id}").json()
    assert "the robot was started with another" in case["procedure"]["next"]
    answer = room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["distal"]})
    assert answer.status_code == 409
    assert answer.json()["code"] == "hexapod_mismatch"
    of_case, of_robot = case["hexapod"]["sha256"], samples.HEXAPOD_SHA256
    assert of_case[:12] in answer.json()["detail"]
    assert of_robot[:12] in answer.json()["detail"]
    back = room.patch(f"/cases/{case_id}", {"hexapod": "hexapod-h70", "why": "it was the other one"})
    assert back.json()["hexapod"]["sha256"] == of_robot


def test_a_case_of_an_older_record_is_compared_by_what_its_file_says(room: Room) -> None:
    """There, a part of the catalogue lies under the hash of its file's bytes."""
    case_id = room.open_case()
    case = room.gateway.cases.case(case_id)
    assert room.gateway.procedure.situation(case).hexapod_agrees
    with room.gateway.record.write() as unit:
        kept_as = unit.put_document(hexapod_file())
    assert kept_as != case.setup.hexapod.sha256
    setup = replace(case.setup, hexapod=replace(case.setup.hexapod, sha256=kept_as))
    older = replace(case, setup=setup)
    assert room.gateway.procedure.situation(older).hexapod_agrees
