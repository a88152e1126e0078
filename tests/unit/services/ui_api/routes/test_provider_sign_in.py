"""Signing in with a real identity provider that runs beside the gateway: there and back, as a browser would."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest

from distalock.local_ports import free_ports
from services.ui_api.core.access_settings import SETUP_FILE
from services.ui_api.core.account_event_data import AccountChanged
from services.ui_api.core.roles import Role
from shared.pki.private_files import write_private
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.people import PASSWORD, add_account
from tests.unit.services.ui_api.room import Room, open_room


@pytest.fixture(scope="module")
def issuer() -> Iterator[str]:
    """A provider in a process of its own."""
    (port,) = free_ports(1)
    people = (
        {"sub": "1", "preferred_username": "dr.a", "groups": ["or-surgeons"]},
        {"sub": "2", "preferred_username": "visitor", "groups": ["everybody"]},
        {"sub": "3", "preferred_username": "nora", "groups": ["or-surgeons"]},
    )
    claims = [word for one in people for word in ("--user-claims", json.dumps(one))]
    command = [sys.executable, "-W", "ignore", "-m", "oidc_provider_mock", "--port", str(port), *claims]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        url = f"http://localhost:{port}"
        try:
            deadline_s = time.monotonic() + PATIENCE_S
            while not _answers(url):
                assert time.monotonic() < deadline_s, "the provider does not answer"
                time.sleep(0.1)
            yield url
        finally:
            process.terminate()


def _answers(url: str) -> bool:
    try:
        return httpx.get(url, timeout=PATIENCE_S).status_code == 200
    except httpx.HTTPError:
        return False


@pytest.fixture
def room(issuer: str, tmp_path: Path) -> Iterator[Room]:
    with open_room(tmp_path, **_settings(issuer, tmp_path)) as opened:
        yield opened


def _settings(issuer: str, folder: Path) -> dict[str, object]:
    secret = folder / "secret"
    write_private(secret, b"between us\n")
    return {
        "provider_issuer": issuer,
        "provider_client_id": "or1",
        "provider_client_secret_file": secret,
        "provider_roles": {"or-surgeons": "surgeon", "or-viewers": "viewer"},
    }


def _came_back(browser: httpx.Client, subject: str) -> httpx.Response:
    """There, signed in there, and back: the answer of the gateway to the way back."""
    departed = browser.get("/api/v1/sessions/provider")
    assert departed.status_code == 303, departed.text
    there = httpx.post(departed.headers["location"], data={"sub": subject}, timeout=PATIENCE_S)
    assert there.is_redirect, there.text
    back = urlsplit(there.headers["location"])
    return browser.get(f"{back.path}?{back.query}")


@pytest.fixture
def browser(room: Room) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=room.client.base_url, timeout=PATIENCE_S) as client:
        yield client


def test_a_surgeon_signs_in_there_and_is_known_here(room: Room, browser: httpx.Client, issuer: str) -> None:
    assert browser.get("/api/v1/sessions/ways").json() == {"provider": issuer}
    back = _came_back(browser, "1")
    assert (back.status_code, back.headers["location"]) == (303, "/")
    assert "SameSite=strict" in back.headers["set-cookie"]
    me = browser.get("/api/v1/users/me").json()
    assert (me["name"], me["roles"], me["authenticated_by"]) == ("dr.a", ["surgeon"], "provider")
    assert _came_back(browser, "1").status_code == 303, "a second time it is the same account"
    made = [e.data for e in room.gateway.record.events_after(0) if isinstance(e.data, AccountChanged)]
    assert [(one.user_name, one.change) for one in made] == [("dr.a", "created")]
    refused = browser.post("/api/v1/sessions", json={"name": "dr.a", "password": PASSWORD})
    assert refused.json()["code"] == "login_failed", "there is no password to guess"


def test_the_set_up_link_ends_with_the_first_account_also_of_the_provider(issuer: str, tmp_path: Path) -> None:
    with open_room(tmp_path, demo_token_file=None, **_settings(issuer, tmp_path)) as room:
        link = (tmp_path / SETUP_FILE).read_text().strip()
        with httpx.Client(base_url=room.client.base_url, timeout=PATIENCE_S) as browser:
            assert _came_back(browser, "1").status_code == 303
            assert not (tmp_path / SETUP_FILE).exists()
            made = browser.post(link, data={"name": "root.of.all", "password": PASSWORD})
        assert (made.status_code, made.json()["code"]) == (403, "setup_link_invalid")
        (account,) = room.gateway.access.accounts.all()
    assert (account.name, set(account.roles)) == ("dr.a", {Role.SURGEON})


def test_who_has_no_role_or_the_name_of_another_is_not_let_in(room: Room, browser: httpx.Client) -> None:
    add_account(room, "nora", Role.VIEWER)
    for subject, code in (("2", "provider_roles_missing"), ("3", "user_exists")):
        back = _came_back(browser, subject)
        assert back.json()["code"] == code
        assert browser.get("/api/v1/users/me").status_code == 401


def test_who_loses_all_roles_there_has_none_here(room: Room, browser: httpx.Client, issuer: str) -> None:
    person: dict[str, object] = {"preferred_username": "dr.b", "groups": ["or-surgeons"]}
    httpx.put(f"{issuer}/users/4", json=person, timeout=PATIENCE_S)
    assert _came_back(browser, "4").status_code == 303
    httpx.put(f"{issuer}/users/4", json=person | {"groups": []}, timeout=PATIENCE_S)
    with httpx.Client(base_url=room.client.base_url, timeout=PATIENCE_S) as elsewhere:
        for _ in range(2):
            assert _came_back(elsewhere, "4").json()["code"] == "provider_roles_missing"
    for asked in (browser.get("/api/v1/users/me"), browser.post("/api/v1/sessions/refresh")):
        assert asked.status_code == 401, "the session of before has ended"
    assert room.get("/users/dr.b").json()["roles"] == []
    events = room.gateway.record.events_after(0)
    recorded = [(e.data.change, e.data.roles, e.who) for e in events if isinstance(e.data, AccountChanged)]
    assert recorded == [("created", ("surgeon",), "dr.b"), ("roles_changed", (), "gateway")]
    httpx.put(f"{issuer}/users/4", json=person, timeout=PATIENCE_S)
    assert _came_back(browser, "4").status_code == 303
    assert browser.get("/api/v1/users/me").json()["roles"] == ["surgeon"]


def test_reduced_roles_apply_also_where_the_name_has_become_unusable(
    room: Room, browser: httpx.Client, issuer: str
) -> None:
    person: dict[str, object] = {"preferred_username": "dr.c", "groups": ["or-surgeons"]}
    httpx.put(f"{issuer}/users/5", json=person | {"preferred_username": "7"}, timeout=PATIENCE_S)
    assert _came_back(browser, "5").json()["code"] == "provider_name_unusable", "there is no account of his"
    httpx.put(f"{issuer}/users/5", json=person, timeout=PATIENCE_S)
    assert _came_back(browser, "5").status_code == 303
    person = {"preferred_username": "7", "groups": ["or-viewers"]}
    httpx.put(f"{issuer}/users/5", json=person, timeout=PATIENCE_S)
    with httpx.Client(base_url=room.client.base_url, timeout=PATIENCE_S) as elsewhere:
        assert _came_back(elsewhere, "5").status_code == 303
        me = elsewhere.get("/api/v1/users/me").json()
    assert (me["name"], me["roles"]) == ("dr.c", ["viewer"])
    assert browser.get("/api/v1/users/me").status_code == 401, "the surgeon's session has ended"


def test_the_way_back_without_a_code_says_why(browser: httpx.Client) -> None:
    back = browser.get("/api/v1/sessions/provider/return?state=x&error=access_denied&session_state=theirs")
    assert (back.status_code, back.json()["code"]) == (401, "provider_refused")
    assert "access_denied" in back.json()["detail"]
    unknown = browser.get("/api/v1/sessions/provider/return?state=x&code=y")
    assert (unknown.status_code, unknown.json()["code"]) == (401, "sign_in_unknown")
