"""People with accounts in a room of the gateway's tests."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import httpx

from distalock.rest_client import bearer
from services.ui_api.access.accounts import Account
from services.ui_api.access.passwords import Passwords
from services.ui_api.access.sessions import Tokens
from services.ui_api.core.identity import Authenticated
from services.ui_api.core.roles import Role
from tests.unit.services.ui_api.room import Room

PASSWORD = "four words and a nail"


def add_account(room: Room, name: str, *roles: Role) -> None:
    """An account with the password of these tests, as an administrator would make it."""
    account = Account(name, frozenset(roles), _hashed(), disabled=False, created_at_ns=0)
    with room.gateway.record.write() as unit:
        room.gateway.access.accounts.create(unit, account, "test")


@cache
def _hashed() -> str:
    """Once for all: it is slow on purpose."""
    return Passwords().hashed(PASSWORD)


def tokens_of(room: Room, name: str) -> Tokens:
    """A session of its own, as after signing in; the password is not compared."""
    access = room.gateway.access
    return access.sessions.open(lambda _: access.accounts.account(name), Authenticated.PASSWORD)


def end_session_of(room: Room, access_token: str) -> None:
    """End the session that a token is of, at once."""
    sessions = room.gateway.access.sessions
    session_id = sessions.user_of(access_token).session_id
    assert session_id is not None
    sessions.end(session_id)


@contextmanager
def signed_in(room: Room, name: str) -> Iterator[httpx.Client]:
    """A client of its own, with a session."""
    headers = bearer(tokens_of(room, name).access_token)
    with httpx.Client(base_url=room.client.base_url, headers=headers, timeout=room.client.timeout) as client:
        yield client
