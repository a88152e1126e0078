"""Cases: parts are validated before anything is stored, and the bus hears of every change."""

import hashlib
import json
import queue
from collections.abc import Callable
from pathlib import Path

import pytest

from shared.bus.keys import Keys
from shared.bus.port import Sample
from shared.messages.base import decode
from shared.messages.cases import CaseContext
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import ROOM, Room, new_key, open_room, wait_until


def _contexts(room: Room) -> Callable[[], CaseContext]:
    """A late joiner on the bus; each call waits for its next context."""
    heard: queue.Queue[CaseContext] = queue.Queue()

    def hear(sample: Sample) -> None:
        heard.put(decode(CaseContext, sample.payload))

    room.imaging.bus.subscribe_retained(Keys(ROOM).case_context, hear)
    return lambda: heard.get(timeout=PATIENCE_S)


def test_the_open_case_is_told_on_the_bus_with_its_part_files(room: Room) -> None:
    heard = _contexts(room)
    assert heard().case_id is None
    case_id = room.open_case()
    context = heard()
    assert (context.case_id, context.revision, context.side) == (case_id, 1, "left")
    assert context.drill_diameter_mm == 4.0
    assert json.loads(context.nail_json) == samples.nail_file()
    assert json.loads(context.hexapod_json)["schema"] == "distalock/hexapod/1"
    room.post(f"/cases/{case_id}/steps", {"step": "mount_moved"})
    assert heard().revision == 2
    room.post(f"/cases/{case_id}/steps", {"step": "abandoned"})
    assert heard().case_id is None


def test_a_case_gives_its_part_files_also_those_that_are_in_no_catalogue(room: Room) -> None:
    case_id = room.open_case()
    used = room.get(f"/cases/{case_id}").json()
    assert room.get(f"/cases/{case_id}/parts/nail").json() == samples.nail_file()
    for kind in ("ring", "guide", "nail", "hexapod"):
        file = room.get(f"/cases/{case_id}/parts/{kind}")
        assert file.headers["content-type"] == "application/json"
        assert hashlib.sha256(file.content).hexdigest() == used[kind]["sha256"]
    unknown = room.get(f"/cases/{case_id}/parts/drill")
    assert (unknown.status_code, unknown.json()["code"]) == (422, "request_invalid")


def test_one_case_is_open_at_a_time(room: Room) -> None:
    first = room.open_case()
    refused = room.post("/cases", samples.case_body())
    assert (refused.status_code, refused.json()["code"]) == (409, "case_already_open")
    room.post(f"/cases/{first}/steps", {"step": "abandoned"})
    second = room.open_case()
    assert [c["id"] for c in room.get("/cases").json()["items"]] == [first, second]


def _without(part: dict[str, object], key: str) -> dict[str, object]:
    return {k: v for k, v in part.items() if k != key}


@pytest.mark.parametrize(
    ("changes", "code", "sentence"),
    [
        ({"ring": "no-such-ring"}, "unknown_part", "the catalogue has no ring named 'no-such-ring'"),
        ({"ring": "hexapod-h70"}, "part_file_invalid", "ring 'hexapod-h70': its schema is 'distalock/hexapod/1'"),
        ({"hexapod": samples.ring_file()}, "part_file_invalid", "expected 'distalock/hexapod/1'"),
        (
            {"ring": samples.ring_file() | {"colour": "red"}},
            "part_file_invalid",
            "ring 'inline': colour: Extra inputs are not permitted",
        ),
        (
            {"ring": samples.ring_file() | {"ball_count": 7}},
            "part_file_invalid",
            "ball_count says 7, the file lists 16 balls",
        ),
        ({"nail": _without(samples.nail_file(), "material")}, "part_file_invalid", "material: Field required"),
        ({"guide_calibration": samples.ring_file()}, "part_file_invalid", "expected 'distalock/guide/1'"),
        (
            {
                "guide": samples.guide_file() | {"holes": samples.guide_file()["holes"][:1]},  # type: ignore[index]
                "guide_calibration": samples.guide_file(),
            },
            "guide_calibration_mismatch",
            "has holes proximal, distal, the guide 'inline' has proximal",
        ),
        (
            {"drill_diameter_mm": 12.0},
            "request_invalid",
            "drill_diameter_mm is 12 (limit: at most 10); give the diameter of the drill",
        ),
        (
            {"head_extension_mm": 30.0},
            "request_invalid",
            "head_extension_mm is 30 (limit: at least 40); read it off the scale of the hexapod's head",
        ),
        (
            {"nail": "Nail femur 11"},
            "request_invalid",
            "nail is 'Nail femur 11', which is no part; give a name from the catalogue (GET /parts lists them",
        ),
        ({"head_extension_mm": "60"}, "request_invalid", "head_extension_mm is '60'; send a number without quotes"),
        ({"side": "middle"}, "request_invalid", "side is 'middle'; send 'left' or 'right'"),
        ({"colour": "red"}, "request_invalid", "colour is not known here; leave it out"),
    ],
)
def test_what_is_wrong_with_a_case_is_one_sentence(
    quiet_room: Room, changes: dict[str, object], code: str, sentence: str
) -> None:
    answer = quiet_room.post("/cases", samples.case_body(**changes))
    assert (answer.status_code, answer.json()["code"]) == (422, code), answer.text
    assert sentence in answer.json()["detail"]
    assert "\n" not in answer.json()["detail"]
    assert quiet_room.get("/cases").json()["items"] == []


def test_parts_without_a_hole_in_common_are_refused(quiet_room: Room) -> None:
    nail = samples.nail_file()
    holes = [{**h, "id": f"other-{h['id']}"} for h in nail["holes"]]  # type: ignore[attr-defined]
    answer = quiet_room.post("/cases", samples.case_body(nail=nail | {"holes": holes}))
    assert (answer.status_code, answer.json()["code"]) == (422, "no_common_hole")


def test_a_nail_is_locked_in_the_bone_that_it_is_made_for(quiet_room: Room) -> None:
    femoral, tibial = "nail-femur-ti-10", "nail-tibia-ti-10"
    refused = quiet_room.post("/cases", samples.case_body(nail=femoral, bone="tibia"))
    assert (refused.status_code, refused.json()["code"]) == (422, "nail_of_other_bone")
    assert "'nail-femur-ti-10' is made for the femur, the case's bone is the tibia" in refused.json()["detail"]
    case_id = quiet_room.post("/cases", samples.case_body(nail=femoral)).json()["id"]
    for change in ({"nail": tibial}, {"bone": "tibia"}):
        answer = quiet_room.patch(f"/cases/{case_id}", change)
        assert (answer.status_code, answer.json()["code"]) == (422, "nail_of_other_bone")
    both = quiet_room.patch(f"/cases/{case_id}", {"bone": "tibia", "nail": tibial}).json()
    assert (both["bone"], both["nail"]["name"]) == ("tibia", tibial)


def test_a_calibrated_guide_takes_the_place_of_the_nominal_one(room: Room) -> None:
    measured = samples.guide_file() | {"ball_count": 16}
    answer = room.post("/cases", samples.case_body(guide_calibration=measured)).json()
    assert answer["guide_calibrated"] is True
    sha256 = answer["guide"]["sha256"]
    assert json.loads(room.gateway.record.document(sha256)) == measured


def test_a_change_of_the_set_up_counts_the_revision_up(room: Room) -> None:
    case_id = room.open_case()
    etag = room.get(f"/cases/{case_id}").headers["etag"]
    path = f"/cases/{case_id}"
    changed = room.patch(path, {"mount": "nail_head"}, etag)
    assert (changed.json()["revision"], changed.json()["mount"]) == (2, "nail_head")
    stale = room.patch(path, {"mount": "bone"}, etag)
    assert (stale.status_code, stale.json()["code"]) == (412, "case_changed")
    same = room.patch(path, {"mount": "nail_head"})
    assert same.json()["revision"] == 2, "nothing changed, so nothing is stale"
    thinner = room.patch(path, {"drill_diameter_mm": 3.2})
    assert (thinner.json()["revision"], thinner.json()["drill_diameter_mm"]) == (3, 3.2)


@pytest.mark.requirement("GW-04")
def test_steps_out_of_order_need_a_reason(room: Room) -> None:
    case_id = room.open_case()
    path = f"/cases/{case_id}/steps"
    refused = room.post(path, {"step": "drilled"})
    assert (refused.status_code, refused.json()["code"]) == (409, "step_out_of_order")
    assert "say why" in refused.json()["detail"]
    recorded = room.post(path, {"step": "drilled", "hole_ids": ["distal"], "why": "drilled freehand"})
    assert recorded.status_code == 201
    assert recorded.json()["procedure"]["drilled_hole_ids"] == ["distal"]
    event = room.gateway.record.events_after(0, case_id)[-1]
    assert event.why == "drilled freehand"


def test_a_step_with_an_unknown_hole_is_refused(room: Room) -> None:
    answer = room.post(f"/cases/{room.open_case()}/steps", {"step": "wires_inserted", "hole_ids": ["third"]})
    assert (answer.status_code, answer.json()["code"]) == (422, "unknown_hole")
    assert answer.json()["detail"] == "hole 'third' is not known; the case has proximal, distal"


def test_a_closed_case_takes_nothing_more(room: Room) -> None:
    case_id = room.open_case()
    room.post(f"/cases/{case_id}/steps", {"step": "abandoned"})
    for answer in (
        room.post(f"/cases/{case_id}/steps", {"step": "drilled", "why": "late"}),
        room.patch(f"/cases/{case_id}", {"side": "right"}),
        room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["distal"]}),
        room.post(f"/cases/{case_id}/verifications", {"images": [samples.sha("x")]}),
    ):
        assert (answer.status_code, answer.json()["code"]) == (409, "case_closed")


def test_lists_come_in_pages(room: Room) -> None:
    opened = []
    for _ in range(5):
        opened.append(room.open_case())
        room.post(f"/cases/{opened[-1]}/steps", {"step": "abandoned"})
    seen: list[str] = []
    cursor = ""
    while cursor is not None:
        listed = room.get(f"/cases?limit=2{f'&cursor={cursor}' if cursor else ''}").json()
        seen += [c["id"] for c in listed["items"]]
        cursor = listed["next_cursor"]
    assert seen == opened
    bad = room.get("/cases?cursor=nonsense")
    assert (bad.status_code, bad.json()["code"]) == (400, "cursor_invalid")


def test_the_catalogue_lists_what_can_be_named(quiet_room: Room) -> None:
    parts = quiet_room.get("/parts").json()
    assert {"name": "hexapod-h70", "kind": "hexapod"}.items() <= next(
        p for p in parts if p["kind"] == "hexapod"
    ).items()
    bones = {p["name"]: p["bone"] for p in parts}
    assert (bones["nail-femur-ti-10"], bones["nail-tibia-ti-10"], bones["ring-120"]) == ("femur", "tibia", None)
    part = quiet_room.get("/parts/hexapod-h70")
    assert part.json()["schema"] == "distalock/hexapod/1"
    assert quiet_room.get("/parts/none").json()["code"] == "part_not_found"


@pytest.mark.parametrize("path", ["", "/images", "/localisations", "/localisations/1", "/plans", "/verifications/1"])
def test_an_unknown_case_is_not_found(quiet_room: Room, path: str) -> None:
    answer = quiet_room.get(f"/cases/case-none{path}")
    assert (answer.status_code, answer.json()["code"]) == (404, "case_not_found")


def test_a_case_opened_twice_under_one_key_is_opened_once(room: Room) -> None:
    key = new_key()
    first, second = (room.post("/cases", samples.case_body(), key=key) for _ in range(2))
    assert (first.status_code, first.text) == (second.status_code, second.text)
    assert first.headers["location"] == second.headers["location"] == f"/api/v1/cases/{first.json()['id']}"
    other = room.post("/cases", samples.case_body(side="right"), key=key)
    assert (other.status_code, other.json()["code"]) == (422, "idempotency_key_reused")


def test_a_refusal_is_remembered_with_its_key(room: Room) -> None:
    """A repeat that arrives late must not act because the state of things has changed in the meantime."""
    first = room.open_case()
    refused = room.post("/cases", samples.case_body(), key="refused")
    room.post(f"/cases/{first}/steps", {"step": "abandoned"})
    again = room.post("/cases", samples.case_body(), key="refused")
    assert (again.status_code, again.text) == (409, refused.text)
    assert again.headers["content-type"] == "application/problem+json"


@pytest.mark.requirement("OPS-03")
def test_no_case_is_opened_while_a_disk_fills(tmp_path: Path) -> None:
    with open_room(tmp_path / "here", announce_free_percent=100.0, announce_free_mib=1e12) as room:
        answer = room.post("/cases", samples.case_body())
        assert (answer.status_code, answer.json()["code"]) == (503, "disk_fills")
        assert "no new case is opened: the disk of" in answer.json()["detail"]


@pytest.mark.requirement("OPS-03")
def test_no_case_is_opened_while_imagings_disk_fills_and_an_open_one_goes_on(room: Room) -> None:
    case_id = room.open_case()
    room.imaging.status.impair("disk", "the disk of /elsewhere fills")
    heard = room.gateway.services.heard["imaging"]
    wait_until(lambda: heard.status is not None and heard.status.impaired == ("disk",))
    assert room.image("one", case_id).case_id == case_id
    assert room.post(f"/cases/{case_id}/steps", {"step": "abandoned"}).status_code == 201
    refused = room.post("/cases", samples.case_body())
    assert (refused.status_code, refused.json()["code"]) == (503, "disk_fills")
    assert "imaging reports: the disk of /elsewhere fills" in refused.json()["detail"]
    room.imaging.status.impair("disk", None)
    wait_until(lambda: heard.status is not None and not heard.status.impaired)
    room.open_case()
