"""Filters, order, sparse fields, conditional reading and smaller pictures."""

import cv2
import numpy as np

from services.ui_api.core.picture import narrowed, png_of
from services.ui_api.routes.pages import page
from shared.errors import ReasonCode
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.room import Room


def _numbers(room: Room, path: str) -> list[int]:
    return [item["number"] for item in room.get(path).json()["items"]]


def _even(number: int) -> bool:
    return number % 2 == 0


def test_a_filtered_page_leaves_nothing_out_and_brings_nothing_twice() -> None:
    first = page(range(10), None, 2, str, wanted=_even)
    second = page(range(12), first.next_cursor, 2, str, wanted=_even)
    last = page(range(12), second.next_cursor, 2, str, wanted=_even)
    assert (first.items, second.items, last.items) == (["0", "2"], ["4", "6"], ["8", "10"])
    assert last.next_cursor is None


def test_the_newest_come_first_and_what_comes_meanwhile_does_not_shift_the_rest() -> None:
    first = page(range(5), None, 2, str, sort="newest")
    second = page(range(7), first.next_cursor, 2, str, sort="newest")
    last = page(range(1, 7), second.next_cursor, 2, str, 1, sort="newest")
    assert (first.items, second.items, last.items, last.next_cursor) == (["4", "3"], ["2", "1"], [], None)


def test_lists_are_filtered_and_sorted(room: Room) -> None:
    case_id = room.open_case()
    room.image("good", case_id)
    room.image("bad", case_id, ReasonCode.NAIL_NOT_FOUND)
    path = f"/cases/{case_id}"
    assert _numbers(room, f"{path}/localisations?verdict=accepted") == [1]
    assert _numbers(room, f"{path}/localisations?verdict=rejected") == [2]
    assert _numbers(room, f"{path}/localisations?sort=newest") == [2, 1]
    room.image("third", case_id)
    room.post(f"{path}/plans", {"localisation": 3, "hole_ids": ["distal"]})
    assert _numbers(room, f"{path}/plans?hole=distal") == [1]
    assert _numbers(room, f"{path}/plans?hole=proximal") == _numbers(room, f"{path}/plans?since=2999-01-01T00:00:00Z")
    assert [c["id"] for c in room.get("/cases?status=open").json()["items"]] == [case_id]
    assert room.get("/cases?status=closed").json()["items"] == []
    room.post("/robot/acknowledge-stop")
    room.log.wait_for(lambda: not room.gateway.record.ledger.pending_operations())
    succeeded = [one["verb"] for one in room.get("/operations?status=succeeded").json()["items"]]
    # also each image's way to its localisation is an operation, and one that was rejected has arrived as well
    assert sorted(succeeded) == ["acknowledge_stop", "localise", "localise", "localise"]
    assert room.get("/operations?status=failed").json()["items"] == []


def test_only_the_fields_that_are_asked_for(room: Room) -> None:
    case_id = room.open_case()
    room.image("one", case_id)
    path = f"/cases/{case_id}/localisations"
    assert room.get(f"{path}?fields=number,verdict").json()["items"] == [{"number": 1, "verdict": "accepted"}]
    assert room.get(f"{path}/1?fields=verdict").json() == {"verdict": "accepted"}
    refused = room.get(f"{path}?fields=colour")
    assert (refused.status_code, refused.json()["code"]) == (400, "unknown_field")
    assert refused.json()["detail"].startswith("there is no field 'colour'; there are ")
    assert ", number, " in refused.json()["detail"]


def test_what_is_known_is_not_sent_again(room: Room) -> None:
    case_id = room.open_case()
    for path in (f"/cases/{case_id}", "/cases", "/parts", "/parts/ring-120", "/users/me", f"/cases/{case_id}/timeline"):
        etag = room.get(path).headers["etag"]
        again = room.client.get(f"/api/v1{path}", headers={"If-None-Match": f'"other", W/{etag}'})
        assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", etag), path
    etag = room.get(f"/cases/{case_id}").headers["etag"]
    room.image("one", case_id)
    changed = room.client.get(f"/api/v1/cases/{case_id}", headers={"If-None-Match": etag})
    assert (changed.status_code, changed.json()["images"]) == (200, 1)
    assert room.client.get("/api/v1/cases/none", headers={"If-None-Match": "*"}).status_code == 404


def test_a_plan_is_always_sent_because_its_etag_is_of_what_is_approved(room: Room) -> None:
    case_id = room.open_case()
    number = room.approved_plan(case_id)
    answer = room.get(f"/cases/{case_id}/plans/{number}")
    again = room.client.get(
        f"/api/v1/cases/{case_id}/plans/{number}", headers={"If-None-Match": answer.headers["etag"]}
    )
    assert again.json()["approval"]["plan"] == number


def test_a_picture_is_drawn_once_and_kept(room: Room) -> None:
    image = room.image("one", room.open_case())
    path = f"/images/{image.sha256}.png"
    full, half = room.get(path), room.get(f"{path}?width=4096")
    assert full.headers["cache-control"] == "private, no-cache"
    assert full.headers["etag"] != half.headers["etag"]
    room.imaging.silent = True  # who draws again asks in vain
    known = room.client.get(f"/api/v1{path}", headers={"If-None-Match": full.headers["etag"]})
    assert (known.status_code, known.content) == (304, b"")
    assert room.get(f"{path}?width=8").status_code == 422


def test_a_picture_is_made_smaller_and_never_larger() -> None:
    png = png_of(np.zeros((60, 100), dtype=np.uint8))
    small = cv2.imdecode(np.frombuffer(narrowed(png, 50), dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    assert small is not None
    assert small.shape == (30, 50)
    assert narrowed(png, 100) == narrowed(png, 300) == png


def test_the_timeline_tells_what_happened(room: Room) -> None:
    case_id = room.open_case()
    number = room.approved_plan(case_id)
    room.post(f"/cases/{case_id}/steps", {"step": "mount_moved"})
    entries = room.get(f"/cases/{case_id}/timeline").json()["items"]
    assert [e["kind"] for e in entries] == [
        "case_opened",
        "image_received",
        "localisation_received",
        "plan_made",
        "plan_approved",
        "step_recorded",
        "setup_changed",
    ]
    assert entries[4]["what"] == f"Plan {number} approved by demo."
    assert entries[2]["picture"] == f"/api/v1/images/{samples.sha('image')}.png?view=overlay"
    for entry in entries:
        assert room.client.get(entry["href"]).status_code == 200
    seen, cursor = [], ""
    while cursor is not None:
        part = room.get(f"/cases/{case_id}/timeline?limit=3{cursor and '&cursor='}{cursor}").json()
        seen += part["items"]
        cursor = part["next_cursor"]
    assert seen == entries
