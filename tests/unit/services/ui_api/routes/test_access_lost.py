"""Whoever loses access while a request is on its way does nothing with it, whether its body is late or its turn is."""

import http.client
import json
from collections.abc import Iterator
from contextlib import contextmanager

import httpx
import pytest

from services.ui_api.core.roles import Role
from services.ui_api.record.unit_of_work import RememberedAnswer
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.people import PASSWORD, add_account, signed_in, tokens_of
from tests.unit.services.ui_api.room import Room, new_key, wait_until

LOST = ("disabled", "role taken away", "session ended")


@pytest.mark.parametrize("how", LOST)
def test_a_motion_whose_sender_loses_access_before_its_body_comes_is_refused(room: Room, how: str) -> None:
    case_id = room.open_case()
    number = room.approved_plan(case_id)
    add_account(room, "nora", Role.SURGEON)
    body = json.dumps({"plan": number}).encode()
    with _head_sent(room, f"/cases/{case_id}/motions", tokens_of(room, "nora").access_token, body) as connection:
        _lose_access(room, how)
        connection.send(body)
        answer = connection.getresponse()
        assert (answer.status, json.loads(answer.read())["code"]) == (401, "token_invalid")
    assert room.robot.moves == []


def test_a_motion_whose_body_comes_late_is_begun(room: Room) -> None:
    case_id = room.open_case()
    number = room.approved_plan(case_id)
    add_account(room, "nora", Role.SURGEON)
    body = json.dumps({"plan": number}).encode()
    with _head_sent(room, f"/cases/{case_id}/motions", tokens_of(room, "nora").access_token, body) as connection:
        connection.send(body)
        answer = connection.getresponse()
        begun = json.loads(answer.read())
    assert answer.status == 202, begun
    room.wait_for_status(begun["id"], "running")


@pytest.mark.requirement("GW-01")
@pytest.mark.parametrize("how", LOST)
def test_an_approval_is_not_recorded_after_its_surgeon_lost_access(
    room: Room, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    add_account(room, "nora", Role.SURGEON)
    case_id = room.open_case()
    room.image("image", case_id)
    plan = room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["proximal", "distal"]})
    with signed_in(room, "nora") as nora:
        headers = {"If-Match": plan.headers["etag"], "Idempotency-Key": new_key()}
        path = f"/api/v1/cases/{case_id}/plans/1/approval"
        _before_it_is_done(room, monkeypatch, how)
        _require_lost(nora.post(path, json={"password": PASSWORD}, headers=headers))
    assert room.get(f"/cases/{case_id}/plans/1").json()["approval"] is None


def test_an_approval_rests_on_the_account_on_record(room: Room) -> None:
    add_account(room, "nora", Role.SURGEON)
    case_id = room.open_case()
    room.image("image", case_id)
    plan = room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["proximal", "distal"]})
    with signed_in(room, "nora") as nora:
        with room.gateway.record.write() as unit:  # this alone ends no session
            room.gateway.access.accounts.set_roles(unit, "nora", frozenset({Role.VIEWER}), "command line")
        headers = {"If-Match": plan.headers["etag"], "Idempotency-Key": new_key()}
        path = f"/api/v1/cases/{case_id}/plans/1/approval"
        _require_lost(nora.post(path, json={"password": PASSWORD}, headers=headers))


@pytest.mark.parametrize("how", LOST)
def test_a_command_is_not_sent_after_its_sender_lost_access(
    room: Room, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    add_account(room, "nora", Role.SURGEON)
    case_id = room.open_case()
    commands = {f"/cases/{case_id}/motions": {"plan": room.approved_plan(case_id)}, "/robot/reset": {}}
    for path, body in commands.items():
        back = {"disabled": False, "roles": ["surgeon"]}
        assert room.client.patch("/api/v1/users/nora", json=back).status_code == 200
        with signed_in(room, "nora") as nora:
            headers = {"If-Match": room.etag_for(path), "Idempotency-Key": new_key()}
            _before_it_is_done(room, monkeypatch, how)
            _require_lost(nora.post(f"/api/v1{path}", json=body, headers=headers))
    assert (room.robot.moves, room.robot.plain) == ([], [])


def _before_it_is_done(room: Room, monkeypatch: pytest.MonkeyPatch, how: str) -> None:
    """Change nora's account when the next request under a key has been admitted, and its credential compared."""
    record = room.gateway.record
    remembered = record.remembered

    def changing(key: str) -> RememberedAnswer | None:
        monkeypatch.setattr(record, "remembered", remembered)
        _lose_access(room, how)
        return remembered(key)

    monkeypatch.setattr(record, "remembered", changing)


def _lose_access(room: Room, how: str) -> None:
    """What an administrator does to nora."""
    match how:
        case "disabled":
            answer = room.client.patch("/api/v1/users/nora", json={"disabled": True})
        case "role taken away":
            answer = room.client.patch("/api/v1/users/nora", json={"roles": ["viewer"]})
        case _:
            answer = room.client.delete("/api/v1/users/nora/sessions")
    assert answer.is_success, answer.text


def _require_lost(answer: httpx.Response) -> None:
    assert (answer.status_code, answer.json()["code"]) == (401, "token_invalid"), answer.text
    assert "ended while the request was worked on" in answer.json()["detail"]


@contextmanager
def _head_sent(room: Room, path: str, token: str, body: bytes) -> Iterator[http.client.HTTPConnection]:
    """A request that was admitted, and whose body is still to come."""
    url = room.client.base_url
    connection = http.client.HTTPConnection(url.host, url.port, timeout=PATIENCE_S)
    try:
        connection.putrequest("POST", f"/api/v1{path}")
        for name, value in {
            "Authorization": f"Bearer {token}",
            "Idempotency-Key": new_key(),
            "If-Match": room.etag_for(path),
            "Content-Type": "application/json",
            "Content-Length": str(len(body)),
        }.items():
            connection.putheader(name, value)
        wait_until(lambda: room.gateway.acting.count == 0)
        connection.endheaders()
        wait_until(lambda: room.gateway.acting.count == 1)
        yield connection
    finally:
        connection.close()
