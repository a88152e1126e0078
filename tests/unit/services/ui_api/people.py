"""People with accounts in a room of the gateway's tests."""

from collections.abc import Iterator
from contextlib import contextmanager

import httpx

from distalock.rest_client import bearer
from services.ui_api.access.accounts import Account
from services.ui_api.core.roles import Role
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import Room

PASSWORD = "four words and a nail"


def add_account(room: Room, name: str, *roles: Role) -> None:
    """An account with the password of these tests, as an administrator would make it."""
    accounts = room.gateway.access.accounts
    hashed = accounts.hashed(name, PASSWORD)
    with room.gateway.record.write() as unit:
        accounts.create(unit, Account(name, frozenset(roles), hashed, disabled=False, created_at_ns=0), "test")


def session_of(room: Room, name: str) -> dict[str, object]:
    """Sign in; the session as it was answered."""
    answer = httpx.post(
        f"{room.client.base_url}/api/v1/sessions", json={"name": name, "password": PASSWORD}, timeout=PATIENCE_S
    )
    assert answer.status_code == 201, answer.text
    session: dict[str, object] = answer.json()
    return session


@contextmanager
def signed_in(room: Room, name: str) -> Iterator[httpx.Client]:
    """A client of its own, with a session."""
    token = str(session_of(room, name)["access_token"])
    with httpx.Client(base_url=room.client.base_url, headers=bearer(token), timeout=room.client.timeout) as client:
        yield client
