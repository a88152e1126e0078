"""Accounts and sessions on both databases, and what a backup takes along of them."""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import pytest
from sqlalchemy import Engine

from services.ui_api.access.accounts import Account, Accounts
from services.ui_api.access.passwords import Passwords
from services.ui_api.access.sessions import ACCESS_TOKEN_S, SESSION_S, Sessions
from services.ui_api.core.roles import Role
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.refusals import Refused
from services.ui_api.record.backup import back_up, restore
from services.ui_api.record.database import open_database, sqlite_url
from services.ui_api.record.record import CaseRecord
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


def refusal(sessions: Sessions, refresh_token: str) -> str:
    with pytest.raises(Refused) as refused:
        sessions.refresh(refresh_token)
    return refused.value.code


def test_tokens_end_with_their_time_and_sessions_with_theirs(engine: Engine) -> None:
    time = Time()
    here = opened(engine, time)
    tokens = here.sessions.open(nora(here))
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
    account = nora(here)
    one, other = here.sessions.open(account), here.sessions.open(account)
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
    tokens = before.sessions.open(nora(before))
    assert opened(engine, time).sessions.refresh(tokens.refresh_token).user.roles == {Role.SURGEON}
    again = before.sessions.open(before.accounts.account("nora"))
    with before.record.write() as unit:
        before.accounts.set_disabled(unit, "nora", "test", disabled=True)
    assert refusal(opened(engine, time).sessions, again.refresh_token) == "refresh_token_invalid"


def test_a_backup_has_the_accounts_and_what_is_restored_has_no_sessions(engine: Engine, tmp_path: Path) -> None:
    time = Time()
    here = opened(engine, time)
    tokens = here.sessions.open(nora(here))
    back_up(engine, tmp_path / "images", tmp_path / "backup", datetime(2026, 1, 2, tzinfo=UTC), "1")
    chain = restore(tmp_path / "backup", sqlite_url(tmp_path / "other"), tmp_path / "other" / "images")
    engine_there = open_database(sqlite_url(tmp_path / "other"))
    there = opened(engine_there, time)
    assert verify_record(engine_there) == chain
    kept = there.accounts.account("nora")
    assert Passwords().matches(PASSWORD, kept.password_hash)
    assert refusal(there.sessions, tokens.refresh_token) == "refresh_token_invalid"
    engine_there.dispose()
