"""Sign in, go on, sign out: tokens of programs and cookies of pages."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from distalock.rest_client import bearer
from services.ui_api.core.account_event_data import AccountChanged
from services.ui_api.core.lockout import FREE_FAILURES
from services.ui_api.core.roles import Role
from services.ui_api.handlers.refusals import Refused
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.people import PASSWORD, add_account, end_session_of, signed_in, tokens_of
from tests.unit.services.ui_api.room import TOKEN, Room, new_key, open_room, wait_until

SESSIONS = "/api/v1/sessions"
ME = "/api/v1/users/me"


def _outcome(answer: httpx.Response) -> tuple[int, str]:
    return answer.status_code, answer.json()["code"]


@pytest.fixture
def outside(room: Room) -> Iterator[httpx.Client]:
    """A client that has brought nothing along."""
    add_account(room, "nora", Role.TECHNICIAN)
    with httpx.Client(base_url=room.client.base_url, timeout=PATIENCE_S) as client:
        yield client


def test_tokens_are_replaced_and_a_copy_ends_the_session(room: Room, outside: httpx.Client) -> None:
    first = outside.post(SESSIONS, json={"name": "nora", "password": PASSWORD}).json()
    second = outside.post(f"{SESSIONS}/refresh", json={"refresh_token": first["refresh_token"]}).json()
    assert {first["refresh_token"], first["access_token"]}.isdisjoint({second["refresh_token"], second["access_token"]})
    for session in (first, second):
        assert outside.get(ME, headers=bearer(str(session["access_token"]))).json()["name"] == "nora"
    copied = outside.post(f"{SESSIONS}/refresh", json={"refresh_token": first["refresh_token"]})
    assert _outcome(copied) == (401, "refresh_token_reused")
    assert copied.headers["www-authenticate"] == "Bearer"
    for session in (first, second):
        assert _outcome(outside.get(ME, headers=bearer(str(session["access_token"])))) == (401, "token_invalid")
    after = outside.post(f"{SESSIONS}/refresh", json={"refresh_token": second["refresh_token"]})
    assert _outcome(after) == (401, "refresh_token_invalid")
    changes = [event.data for event in room.gateway.record.events_after(0) if isinstance(event.data, AccountChanged)]
    assert [(one.user_name, one.change) for one in changes][-1] == ("nora", "refresh_token_reused")


def test_a_page_gets_cookies_that_no_script_reads(outside: httpx.Client) -> None:
    answer = outside.post(SESSIONS, json={"name": "nora", "password": PASSWORD, "keep": "cookie"})
    assert (answer.json()["access_token"], answer.json()["refresh_token"]) == (None, None)
    cookies = answer.headers.get_list("set-cookie")
    assert [cookie.split("=")[0] for cookie in cookies] == ["distalock_access", "distalock_refresh"]
    for cookie in cookies:
        assert "httponly" in cookie.lower()
        assert "samesite=strict" in cookie.lower()
        assert "secure" not in cookie.lower(), "this room speaks HTTP"
    assert outside.get(ME).json()["roles"] == ["technician"]
    assert outside.post(f"{SESSIONS}/refresh").status_code == 200
    foreign = outside.delete(f"{SESSIONS}/current", headers={"Origin": "https://elsewhere.example"})
    assert _outcome(foreign) == (403, "cross_site_request")
    assert outside.delete(f"{SESSIONS}/current").status_code == 204
    assert _outcome(outside.get(ME)) == (401, "token_missing")


def test_a_session_outlives_the_gateway_and_its_access_token_does_not(tmp_path: Path) -> None:
    with open_room(tmp_path) as before:
        add_account(before, "nora", Role.TECHNICIAN)
        session = tokens_of(before, "nora")
    with open_room(tmp_path) as room:
        again = httpx.get(f"{room.client.base_url}{ME}", headers=bearer(session.access_token), timeout=PATIENCE_S)
        assert _outcome(again) == (401, "token_invalid")
        renewed = httpx.post(
            f"{room.client.base_url}{SESSIONS}/refresh",
            json={"refresh_token": session.refresh_token},
            timeout=PATIENCE_S,
        )
        assert renewed.json()["user"] == "nora"


def test_guessing_locks_one_account_for_one_address(room: Room, outside: httpx.Client) -> None:
    add_account(room, "otto", Role.SURGEON)
    for name in ["nora"] * FREE_FAILURES + ["nobody"]:
        wrong = outside.post(SESSIONS, json={"name": name, "password": "not the password"})
        assert _outcome(wrong) == (401, "login_failed"), "a name that is none is answered alike"
    locked = outside.post(SESSIONS, json={"name": "nora", "password": PASSWORD})
    assert _outcome(locked) == (429, "login_locked")
    assert 0 < int(locked.headers["retry-after"]) <= 30
    otto = {"name": "otto", "password": PASSWORD}
    assert outside.post(SESSIONS, json=otto).json()["user"] == "otto"
    elsewhere = room.gateway.access.sign_in("nora", PASSWORD, "192.0.2.7")
    assert elsewhere.user.name == "nora"


def test_a_viewers_stream_ends_with_its_session(room: Room, outside: httpx.Client) -> None:
    token = tokens_of(room, "nora").access_token
    with outside.stream("GET", "/api/v1/events?after=0", headers=bearer(token), timeout=PATIENCE_S) as events:
        lines = events.iter_lines()
        assert next(lines).startswith("id:")
        ended = room.client.delete("/api/v1/users/nora/sessions")
        assert ended.status_code == 204
        for _ in lines:
            pass  # until it ends


def test_a_stream_ends_also_when_its_session_ends_while_it_waits_for_somebody_who_acts(
    room: Room, outside: httpx.Client
) -> None:
    token, acting = tokens_of(room, "nora").access_token, room.gateway.acting
    with outside.stream("GET", "/api/v1/events?after=0", headers=bearer(token), timeout=PATIENCE_S) as events:
        lines = events.iter_lines()
        assert next(lines).startswith("id:")
        with acting.acting():
            room.gateway.feed.wake()
            wait_until(lambda: acting.waiting > 0)
            end_session_of(room, token)
        lines_after = list(lines)  # until it ends
    assert not [line for line in lines_after if line.startswith(":")], "no ping: it ended at once"


def test_an_answer_is_its_users_alone(room: Room, outside: httpx.Client) -> None:
    key = new_key()
    assert room.post("/cases/none/steps", {"step": "finished"}, key=key).status_code == 404
    with signed_in(room, "nora") as nora:
        headers = {"Idempotency-Key": key, "If-Match": '"0-none"'}
        asked = nora.post("/api/v1/cases/none/steps", json={"step": "finished"}, headers=headers)
    assert _outcome(asked) == (422, "idempotency_key_reused")


def test_no_secret_is_kept_as_it_is(room: Room, outside: httpx.Client, capfd: pytest.CaptureFixture[str]) -> None:
    session = tokens_of(room, "nora")
    with pytest.raises(Refused):
        room.gateway.access.sign_in("nora", "another long password", "192.0.2.7")
    kept = b"".join(file.read_bytes() for file in _database_files(room)) + capfd.readouterr().err.encode()
    for secret in (PASSWORD, "another long password", session.access_token, session.refresh_token):
        assert secret.encode() not in kept
    assert b"$argon2id$" in kept


def _database_files(room: Room) -> list[Path]:
    engine = room.gateway.record._engine
    file = Path(str(engine.url.database))
    return [one for one in file.parent.iterdir() if one.name.startswith(file.name)]


def test_the_simulations_user_signs_in_with_its_token(room: Room, outside: httpx.Client) -> None:
    session = outside.post(SESSIONS, json={"name": "demo", "password": TOKEN}).json()
    assert session["roles"] == ["administrator", "surgeon"]
    me = outside.get(ME, headers=bearer(session["access_token"])).json()
    assert (me["name"], me["authenticated_by"]) == ("demo", "simulation_token")
    assert me["banner"].startswith("SIMULATION")
