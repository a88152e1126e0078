"""Whoever loses access while a request is on its way does nothing with it, whether its body is late or its turn is."""

import http.client
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import httpx
import pytest

from services.ui_api import routes
from services.ui_api.core.roles import Role
from services.ui_api.record.unit_of_work import UnitOfWork
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.people import PASSWORD, add_account, signed_in, tokens_of
from tests.unit.services.ui_api.room import Room, new_key, wait_until
from tests.unit.services.ui_api.software_passkey import SoftwarePasskey

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
        problem = json.loads(answer.read())
    assert (answer.status, problem["code"]) == (401, "token_invalid")
    assert "while the request was worked on" not in problem["detail"], "it is refused before anything is worked on"
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
        _before_it_is_recorded(room, monkeypatch, lambda: _lose_access(room, how))
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
            _before_it_is_recorded(room, monkeypatch, lambda: _lose_access(room, how))
            _require_lost(nora.post(f"/api/v1{path}", json=body, headers=headers))
    assert (room.robot.moves, room.robot.plain) == ([], [])


def test_whoever_signs_in_anew_may_ask_again_under_the_same_key(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    add_account(room, "nora", Role.SURGEON)
    case_id = room.open_case()
    path, body = f"/cases/{case_id}/motions", {"plan": room.approved_plan(case_id)}
    headers = {"If-Match": room.etag_for(path), "Idempotency-Key": new_key()}
    with signed_in(room, "nora") as nora:
        _before_it_is_recorded(room, monkeypatch, lambda: _lose_access(room, "session ended"))
        _require_lost(nora.post(f"/api/v1{path}", json=body, headers=headers))
    with signed_in(room, "nora") as nora:
        begun = nora.post(f"/api/v1{path}", json=body, headers=headers)
    assert begun.status_code == 202, begun.text
    room.wait_for_status(begun.json()["id"], "running")


def test_nothing_is_recorded_for_whoever_lost_access(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    add_account(room, "nora", Role.SURGEON)
    case_id = room.open_case()
    room.approved_plan(case_id)
    of_case = f"/cases/{case_id}"
    image = room.gateway.record.ledger.cases[case_id].localisations[0].image_sha256
    writes: tuple[tuple[str, str, object], ...] = (
        ("POST", "/cases", samples.case_body()),
        ("PATCH", of_case, {"head_extension_mm": 70.0}),
        ("POST", f"{of_case}/steps", {"step": "mount_moved"}),
        ("DELETE", f"{of_case}/steps/1", None),
        ("POST", f"{of_case}/plans", {"localisation": 1, "hole_ids": ["proximal", "distal"]}),
        ("DELETE", f"{of_case}/plans/1/approval", None),
        ("POST", f"{of_case}/verifications", {"images": [image]}),
        ("DELETE", "/users/me/passkeys/none", None),
    )
    for method, path, body in writes:
        assert room.client.patch("/api/v1/users/nora", json={"disabled": False}).status_code == 200
        with signed_in(room, "nora") as nora:
            headers = {"If-Match": room.etag_for(path), "Idempotency-Key": new_key()}
            before = room.gateway.record.ledger.cases[case_id]
            _before_it_is_recorded(room, monkeypatch, lambda: _lose_access(room, "disabled"))
            _require_lost(nora.request(method, f"/api/v1{path}", json=body, headers=headers))
        assert room.gateway.record.ledger.cases[case_id] == before, path


def test_an_administrator_who_was_disabled_administers_nothing(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    add_account(room, "nora", Role.ADMINISTRATOR)
    add_account(room, "otto", Role.ADMINISTRATOR, Role.VIEWER)
    accounts = room.gateway.access.accounts
    new = {"name": "back.door", "password": "a long enough secret", "roles": ["administrator"]}
    writes: tuple[tuple[str, str, object], ...] = (
        ("POST", "/users", new),
        ("PATCH", "/users/nora", {"password": "a long enough secret", "disabled": False}),
        ("DELETE", "/users/otto/sessions", None),
        ("DELETE", "/users/otto/passkeys", None),
    )
    with signed_in(room, "otto") as otto:
        for method, path, body in writes:
            assert room.client.patch("/api/v1/users/nora", json={"disabled": False}).status_code == 200
            with signed_in(room, "nora") as nora:
                headers = {"Idempotency-Key": new_key()}
                _before_it_is_recorded(room, monkeypatch, lambda: _lose_access(room, "disabled"))
                _require_lost(nora.request(method, f"/api/v1{path}", json=body, headers=headers))
            assert accounts.account("nora").disabled, path
        assert otto.get("/api/v1/users/me").status_code == 200, "his session goes on"
    assert accounts.find("back.door") is None


@pytest.mark.parametrize("route", ["password", "passkeys"])
@pytest.mark.parametrize("reset", ["over REST", "alone"])
def test_a_password_that_was_reset_meanwhile_changes_nothing_any_more(
    room: Room, monkeypatch: pytest.MonkeyPatch, route: str, reset: str
) -> None:
    add_account(room, "nora", Role.SURGEON)
    accounts = room.gateway.access.accounts

    def by_the_administrator() -> None:
        if reset == "over REST":
            answer = room.client.patch("/api/v1/users/nora", json={"password": "set by the administrator"})
            assert answer.is_success, answer.text
            return
        hashed = accounts.hashed("nora", "set by the administrator")
        with room.gateway.record.write() as unit:  # this alone ends no session
            accounts.set_password(unit, "nora", hashed, "command line")

    with signed_in(room, "nora") as thief:
        if route == "password":
            method, path = "PUT", "password"
            body: dict[str, object] = {"password": PASSWORD, "new_password": "of the thief, long"}
        else:
            options = thief.post("/api/v1/users/me/passkeys/registration").json()["public_key"]
            method, path = "POST", "passkeys"
            body = {"label": "phone", "password": PASSWORD, "credential": SoftwarePasskey().made_for(options)}
        _before_it_is_recorded(room, monkeypatch, by_the_administrator)
        answer = thief.request(method, f"/api/v1/users/me/{path}", json=body)
    assert answer.status_code == 401, answer.text
    assert answer.json()["code"] == ("token_invalid" if reset == "over REST" else "login_failed")
    signed = room.client.post("/api/v1/sessions", json={"name": "nora", "password": "set by the administrator"})
    assert signed.is_success, signed.text
    assert room.gateway.access.passkeys.of("nora") == []


def test_routes_write_only_where_access_is_checked() -> None:
    """`setup` has a link in place of an account, and looks at it in the transaction."""
    sources = {file.stem: file.read_text(encoding="utf-8") for file in Path(routes.__path__[0]).glob("*.py")}
    assert {name for name, text in sources.items() if "record.write()" in text} == {
        "idempotency",
        "setup",
        "transactions",
    }


def _before_it_is_recorded(room: Room, monkeypatch: pytest.MonkeyPatch, change: Callable[[], None]) -> None:
    """Have something done when the next request has been admitted, and its credential compared."""
    record = room.gateway.record
    write = record.write

    def changing() -> AbstractContextManager[UnitOfWork]:
        if threading.current_thread().name.startswith("AnyIO worker"):  # requests', and not the bus's
            monkeypatch.setattr(record, "write", write)
            change()
        return write()

    monkeypatch.setattr(record, "write", changing)


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
