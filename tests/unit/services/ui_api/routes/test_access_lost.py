"""Whoever loses access while a request is on its way does nothing with it: neither with a late body, nor with a consent."""

import http.client
import json
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from services.ui_api.core.roles import Role
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.people import add_account, tokens_of
from tests.unit.services.ui_api.room import Room, new_key, wait_until

LOST = ({"disabled": True}, {"roles": ["viewer"]})


@pytest.mark.parametrize("change", LOST)
def test_a_motion_whose_sender_loses_access_before_its_body_comes_is_refused(
    room: Room, change: dict[str, object]
) -> None:
    case_id = room.open_case()
    number = room.approved_plan(case_id)
    add_account(room, "nora", Role.SURGEON)
    body = json.dumps({"plan": number}).encode()
    with _head_sent(room, f"/cases/{case_id}/motions", tokens_of(room, "nora").access_token, body) as connection:
        assert room.client.patch("/api/v1/users/nora", json=change).status_code == 200
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
