"""Whoever changes a case quotes it as he read it."""

import pytest

from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.room import Room, new_key

_CHANGES: list[tuple[str, str, dict[str, object]]] = [
    ("PATCH", "", {"side": "right"}),
    ("POST", "/steps", {"step": "mount_moved"}),
    ("POST", "/plans", {"localisation": 1, "hole_ids": ["distal"]}),
    ("POST", "/motions", {"plan": 1}),
    ("POST", "/verifications", {"images": [samples.sha("x")]}),
    ("POST", "/qa-reports", {"images": [samples.sha("x")]}),
]


def _send(room: Room, method: str, path: str, body: dict[str, object], **headers: str) -> tuple[int, str]:
    key = {"Idempotency-Key": new_key(), **{name.replace("_", "-"): value for name, value in headers.items()}}
    answer = room.client.request(method, f"/api/v1{path}", json=body, headers=key)
    return answer.status_code, answer.json().get("code", "")


@pytest.mark.requirement("GW-09")
@pytest.mark.parametrize(("method", "what", "body"), _CHANGES)
def test_every_change_of_a_case_quotes_it(room: Room, method: str, what: str, body: dict[str, object]) -> None:
    case_id = room.open_case()
    stale = room.etag_for(f"/cases/{case_id}")
    assert _send(room, method, f"/cases/{case_id}{what}", body) == (428, "precondition_required")
    room.patch(f"/cases/{case_id}", {"mount": "nail_head"})
    for other in (stale, "*", f"{stale}, *", '"nonsense"'):
        assert _send(room, method, f"/cases/{case_id}{what}", body, If_Match=other) == (412, "case_changed"), other


def test_what_is_no_etag_is_not_said_to_be_an_old_one(room: Room) -> None:
    case_id = room.open_case()
    etag = room.etag_for(f"/cases/{case_id}")
    for wrong in ("*", etag.strip('"'), "nonsense"):
        refused = room.patch(f"/cases/{case_id}", {"mount": "nail_head"}, wrong)
        assert "no ETag of a case" in refused.json()["detail"], wrong
    assert (
        "something was decided" in room.patch(f"/cases/{case_id}", {"mount": "nail_head"}, '"0-none"').json()["detail"]
    )


@pytest.mark.requirement("GW-09")
def test_who_was_slower_is_told_the_newest_state(room: Room) -> None:
    case_id = room.open_case()
    stale = room.etag_for(f"/cases/{case_id}")
    first = room.post(f"/cases/{case_id}/steps", {"step": "mount_moved"}, if_match=stale)
    key = new_key()
    second = room.post(f"/cases/{case_id}/steps", {"step": "mount_moved"}, key, stale)
    assert (second.status_code, second.json()["current"]["revision"]) == (412, 2)
    assert second.json()["current"] == room.get(f"/cases/{case_id}").json()
    assert second.headers["etag"] == room.etag_for(f"/cases/{case_id}")
    again = room.post(f"/cases/{case_id}/steps", {"step": "mount_moved"}, key, stale)
    assert (again.text, again.headers["etag"]) == (second.text, second.headers["etag"]), "remembered with its ETag"
    third = room.post(f"/cases/{case_id}/steps", {"step": "mount_moved"}, if_match=first.headers["case-etag"])
    assert third.json()["revision"] == 3


def test_images_stand_in_nobodys_way(room: Room) -> None:
    case_id = room.open_case()
    read = room.etag_for(f"/cases/{case_id}")
    room.image("one", case_id)
    assert room.etag_for(f"/cases/{case_id}") != read, "the case says something else"
    plan = room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["distal"]}, if_match=read)
    assert plan.status_code == 201
    assert plan.headers["case-etag"].split("-")[0] == room.etag_for(f"/cases/{case_id}").split("-")[0]
    after = room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["distal"]}, if_match=read)
    assert (after.status_code, after.json()["code"]) == (412, "case_changed")


def test_a_plan_that_was_not_read_comes_with_the_refusal(room: Room) -> None:
    case_id = room.open_case()
    room.image("one", case_id)
    plan = room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["distal"]})
    refused = room.post(f"/cases/{case_id}/plans/1/approval", if_match=f'"{"0" * 64}"')
    assert (refused.status_code, refused.headers["etag"]) == (412, plan.headers["etag"])
    assert refused.json()["current"]["sha256"] == plan.json()["sha256"]
