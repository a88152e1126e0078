"""Accounts and sessions on both databases, and what a backup takes along of them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import pytest
from sqlalchemy import Engine

from services.ui_api.access.accounts import Account, Accounts
from services.ui_api.access.passwords import Passwords
from services.ui_api.access.sessions import ACCESS_TOKEN_S, SESSION_S, Sessions, Tokens
from services.ui_api.core.identity import Authenticated, ProviderIdentity
from services.ui_api.core.roles import Role
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.refusals import Refused
from services.ui_api.record.backup import back_up
from services.ui_api.record.database import open_database, sqlite_url
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.restore import restore
from services.ui_api.record.unit_of_work import UnitOfWork
from services.ui_api.record.verify import verify_record

PASSWORD = "four words and a nail"
_NS = 10**9


@dataclass(slots=True)
class Time:
    """Both clocks, moved by hand."""

    now_s: float = 1_000.0

    def clock(self) -> Clock:
        return Clock(lambda: int(self.now_s * _NS), lambda: self.now_s)


@dataclass(frozen=True, slots=True)
class Opened:
    record: CaseRecord
    accounts: Accounts
    sessions: Sessions


def opened(engine: Engine, time: Time) -> Opened:
    clock = time.clock()
    record = CaseRecord(engine, clock.unix_ns)
    return Opened(record, Accounts(record, Passwords()), Sessions(record, clock, lambda: None))


def nora(with_: Opened) -> Account:
    hashed = with_.accounts.hashed("nora", PASSWORD)
    with with_.record.write() as unit:
        with_.accounts.create(unit, Account("nora", frozenset({Role.SURGEON}), hashed, False, 0), "test")
    return with_.accounts.account("nora")


def session_of(with_: Opened) -> Tokens:
    return with_.sessions.open(lambda _: with_.accounts.account("nora"), Authenticated.PASSWORD)


def refusal(sessions: Sessions, refresh_token: str) -> str:
    with pytest.raises(Refused) as refused:
        sessions.refresh(refresh_token)
    return refused.value.code


def test_tokens_end_with_their_time_and_sessions_with_theirs(engine: Engine) -> None:
    time = Time()
    here = opened(engine, time)
    nora(here)
    tokens = session_of(here)
    time.now_s += ACCESS_TOKEN_S - 1.0
    assert here.sessions.user_of(tokens.access_token).name == "nora"
    time.now_s += 1.0
    with pytest.raises(Refused, match=r"good for 900 s; renew it") as expired:
        here.sessions.user_of(tokens.access_token)
    assert expired.value.code == "token_expired"
    renewed = here.sessions.refresh(tokens.refresh_token)
    assert renewed.session_s == pytest.approx(SESSION_S - ACCESS_TOKEN_S), "renewal does not lengthen a session"
    assert here.sessions.is_open(str(renewed.user.session_id))
    time.now_s += renewed.session_s
    assert not here.sessions.is_open(str(renewed.user.session_id))
    assert refusal(here.sessions, renewed.refresh_token) == "refresh_token_invalid"


def test_an_expired_token_stays_known_while_others_renew_theirs(engine: Engine) -> None:
    """Its holder is told to renew it; told that it is nobody's, a surgeon would have to sign in again."""
    time = Time()
    here = opened(engine, time)
    nora(here)
    one, other = session_of(here), session_of(here)
    time.now_s += ACCESS_TOKEN_S
    here.sessions.refresh(other.refresh_token)
    for token in (one.access_token, other.access_token):
        with pytest.raises(Refused) as refused:
            here.sessions.user_of(token)
        assert refused.value.code == ("token_expired" if token == one.access_token else "token_invalid")
    assert here.sessions.user_of(here.sessions.refresh(one.refresh_token).access_token).name == "nora"


def test_after_a_restart_a_session_is_renewed_unless_its_account_was_disabled(engine: Engine) -> None:
    time = Time()
    before = opened(engine, time)
    nora(before)
    tokens = session_of(before)
    assert opened(engine, time).sessions.refresh(tokens.refresh_token).user.roles == {Role.SURGEON}
    again = session_of(before)
    with before.record.write() as unit:
        before.accounts.set_disabled(unit, "nora", "test", disabled=True)
    assert refusal(opened(engine, time).sessions, again.refresh_token) == "refresh_token_invalid"


def test_a_backup_has_the_accounts_and_what_is_restored_has_no_sessions(engine: Engine, tmp_path: Path) -> None:
    time = Time()
    here = opened(engine, time)
    nora(here)
    tokens = session_of(here)
    back_up(engine, tmp_path / "images", tmp_path / "backup", datetime(2026, 1, 2, tzinfo=UTC), "1")
    restored = restore(tmp_path / "backup", sqlite_url(tmp_path / "other"), tmp_path / "other" / "images")
    engine_there = open_database(sqlite_url(tmp_path / "other"))
    there = opened(engine_there, time)
    assert verify_record(engine_there) == restored.chain
    kept = there.accounts.account("nora")
    assert Passwords().matches(PASSWORD, kept.password_hash)
    assert refusal(there.sessions, tokens.refresh_token) == "refresh_token_invalid"
    engine_there.dispose()


@pytest.mark.parametrize("change", ["roles", "disabled", "password"])
def test_a_session_has_the_roles_of_when_it_is_opened(engine: Engine, change: str) -> None:
    """Comparing a password takes time, in which an administrator may change the account."""
    here = opened(engine, Time())
    shown = nora(here)
    with here.record.write() as unit:
        if change == "roles":
            here.accounts.set_roles(unit, "nora", frozenset({Role.VIEWER}), "test")
        elif change == "disabled":
            here.accounts.create(unit, Account("other", frozenset({Role.SURGEON}), "none", False, 0), "test")
            here.accounts.set_disabled(unit, "nora", "test", disabled=True)
        else:
            here.accounts.set_password(unit, "nora", here.accounts.hashed("nora", "five other words"), "test")
    if change == "roles":
        tokens = here.sessions.open(lambda _: here.accounts.unchanged(shown), Authenticated.PASSWORD)
        assert here.sessions.user_of(tokens.access_token).roles == {Role.VIEWER}
        return
    with pytest.raises(Refused) as refused:
        here.sessions.open(lambda _: here.accounts.unchanged(shown), Authenticated.PASSWORD)
    assert refused.value.code == "login_failed"


def test_a_session_that_is_being_opened_ends_with_all_of_its_user(engine: Engine) -> None:
    here = opened(engine, Time())
    nora(here)
    with here.record.write() as unit:
        here.sessions.end_all_of(unit, "nora")
    tokens = session_of(here)
    with here.record.write() as unit:
        here.sessions.end_all_of(unit, "nora")
    with pytest.raises(Refused, match="none of a session that is open"):
        here.sessions.user_of(tokens.access_token)


def test_roles_that_the_provider_took_back_end_the_sessions_that_have_them(engine: Engine) -> None:
    here = opened(engine, Time())

    def sign_in(*roles: Role) -> Tokens:
        identity = ProviderIdentity("subject", "dr.a", frozenset(roles))
        return here.sessions.open(
            lambda unit: here.accounts.of_provider(unit, identity, here.sessions.end_all_of), Authenticated.PROVIDER
        )

    surgeon = sign_in(Role.SURGEON)
    assert here.sessions.user_of(sign_in(Role.SURGEON).access_token).roles == {Role.SURGEON}
    assert here.sessions.user_of(surgeon.access_token).roles == {Role.SURGEON}
    viewer = sign_in(Role.VIEWER)
    assert here.sessions.user_of(viewer.access_token).roles == {Role.VIEWER}
    with pytest.raises(Refused) as refused:
        here.sessions.user_of(surgeon.access_token)
    assert refused.value.code == "token_invalid"
    assert refusal(here.sessions, surgeon.refresh_token) == "refresh_token_invalid"


def test_an_account_that_is_there_gets_its_roles_whatever_its_name_is_now(engine: Engine) -> None:
    here = opened(engine, Time())

    def sign_in(name: str, refused: str | None, role: Role) -> Tokens:
        identity = ProviderIdentity("subject", name, frozenset({role}), name_refusal=refused)
        return here.sessions.open(
            lambda unit: here.accounts.of_provider(unit, identity, here.sessions.end_all_of), Authenticated.PROVIDER
        )

    with pytest.raises(Refused, match="it is too short") as refusal_of_name:
        sign_in("7", "it is too short", Role.SURGEON)
    assert (refusal_of_name.value.code, here.accounts.all()) == ("provider_name_unusable", [])
    surgeon = sign_in("dr.a", None, Role.SURGEON)
    viewer = sign_in("7", "it is too short", Role.VIEWER)
    assert (viewer.user.name, viewer.user.roles) == ("dr.a", frozenset({Role.VIEWER}))
    with pytest.raises(Refused, match="none of a session that is open"):
        here.sessions.user_of(surgeon.access_token)


class WatchedRecord(CaseRecord):
    """Has something done as soon as a transaction has ended, when the next one may begin."""

    def __init__(self, engine: Engine, clock: Clock) -> None:
        super().__init__(engine, clock.unix_ns)
        self.after_write: Callable[[], None] = lambda: None

    @contextmanager
    def write(self) -> Iterator[UnitOfWork]:
        """As it is, and then what is to be done."""
        with super().write() as unit:
            yield unit
        self.after_write()


@pytest.mark.parametrize("how", ["sign out", "reuse"])
def test_a_session_has_ended_for_whoever_writes_next(engine: Engine, how: str) -> None:
    clock = Time().clock()
    record = WatchedRecord(engine, clock)
    here = Opened(record, Accounts(record, Passwords()), Sessions(record, clock, lambda: None))
    nora(here)
    tokens = session_of(here)
    session_id = tokens.user.session_id
    assert session_id is not None
    here.sessions.refresh(tokens.refresh_token)
    found: list[bool] = []
    record.after_write = lambda: found.append(here.sessions.is_open(session_id))
    if how == "sign out":
        here.sessions.end(session_id)
    else:
        assert refusal(here.sessions, tokens.refresh_token) == "refresh_token_reused"
    assert found == [False]
