"""Sessions: a short access token, and a refresh token that is replaced with each use.

Both are random and mean nothing by themselves; the gateway keeps their hashes. Access tokens are in memory alone and
end with the process; sessions and refresh tokens are in the record's database. A refresh token that comes a second
time was copied by somebody: the session ends, and whoever of the two is the user signs in anew.
"""

import hashlib
import secrets
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from sqlalchemy import delete, insert, select, update

from services.ui_api.access.accounts import Account, note_change, roles_of_json
from services.ui_api.core.account_event_data import AccountChange
from services.ui_api.core.identity import Authenticated, User
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.refusals import unauthenticated
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.tables import REFRESH_TOKENS, SESSIONS, USERS
from services.ui_api.record.unit_of_work import UnitOfWork

# Chosen: a stolen access token is of use for a quarter of an hour, and a shift needs one login.
ACCESS_TOKEN_S: Final = 900.0
SESSION_S: Final = 12 * 3600.0
_TOKEN_BYTES: Final = 32
_NS: Final = 1e9


@dataclass(frozen=True, slots=True)
class Tokens:
    """What a client gets: each token is seen once."""

    user: User
    access_token: str
    refresh_token: str
    access_s: float
    session_s: float


@dataclass(frozen=True, slots=True)
class _Session:
    user: User
    ends_s: float


@dataclass(frozen=True, slots=True)
class _Access:
    session_id: str
    ends_s: float


class Sessions:
    """Opens, renews and ends sessions, and knows whose token a token is.

    Parameters
    ----------
    on_end
        Called when a session was ended before its time: whoever streams with it must look.
    """

    def __init__(self, record: CaseRecord, clock: Clock, on_end: Callable[[], None]) -> None:
        self._record, self._clock, self._on_end = record, clock, on_end
        self._lock = threading.Lock()
        self._sessions = self._kept()
        self._accesses: dict[str, _Access] = {}

    def user_of(self, access_token: str) -> User:
        """Who holds an access token; raises `Refused`. Reads memory alone, however slow the database is."""
        now_s = self._clock.monotonic_s()
        access = self._accesses.get(_sha256(access_token))
        session = None if access is None else self._sessions.get(access.session_id)
        if access is None or session is None:
            raise unauthenticated("token_invalid", "the access token is none of a session that is open; sign in")
        if min(access.ends_s, session.ends_s) <= now_s:
            raise unauthenticated(
                "token_expired",
                f"the access token was good for {ACCESS_TOKEN_S:g} s; renew it with the refresh token "
                "(POST /sessions/refresh)",
            )
        return session.user

    def is_open(self, session_id: str) -> bool:
        """Whether a session goes on: streams outlast their access token, and not their session."""
        session = self._sessions.get(session_id)
        return session is not None and session.ends_s > self._clock.monotonic_s()

    def open(self, account_now: Callable[[UnitOfWork], Account], shown: Authenticated) -> Tokens:
        """Open a session for somebody who has shown who he is, and how.

        Parameters
        ----------
        account_now
            The account as it is when the session is recorded; raises `Refused`. Showing takes time, in which an
            administrator may have changed it.
        """
        session_id, refresh_token = secrets.token_hex(16), _new_token()
        with self._record.write() as unit:
            account = account_now(unit)
            unit.change(delete(SESSIONS).where(SESSIONS.c.ends_at_ns <= unit.now_ns))
            ends_at_ns = unit.now_ns + int(SESSION_S * _NS)
            unit.change(
                insert(SESSIONS).values(
                    id=session_id,
                    user_name=account.name,
                    opened_at_ns=unit.now_ns,
                    ends_at_ns=ends_at_ns,
                    authenticated_by=str(shown),
                )
            )
            _keep(unit, session_id, refresh_token)
            now_s = self._clock.monotonic_s()
            user = User(account.name, account.roles, shown, session_id, now_s)
            session = _Session(user, now_s + SESSION_S)
            # With the commit: whoever changes the account after it ends this session too.
            unit.after_commit(lambda: self._publish(session_id, session))
        return self._issued(session, session_id, refresh_token)

    def refresh(self, refresh_token: str) -> Tokens:
        """Replace a refresh token, once; raises `Refused`, and ends the session when it was used before."""
        next_token = _new_token()
        with self._record.write() as unit:
            session_id, used = self._session_of(refresh_token)
            session = self._sessions.get(session_id)
            if session is not None and used:
                self._note_reuse(unit, session_id, session)
            elif session is not None:
                used_now = update(REFRESH_TOKENS).where(REFRESH_TOKENS.c.sha256 == _sha256(refresh_token))
                unit.change(used_now.values(used=True))
                _keep(unit, session_id, next_token)
        if session is None or not (used or self.is_open(session_id)):
            raise unauthenticated(
                "refresh_token_invalid", "the refresh token is none of a session that is open; sign in"
            )
        if used:
            raise unauthenticated(
                "refresh_token_reused",
                "the refresh token was used before, so somebody has a copy of it; the session has ended, sign in anew",
            )
        return self._issued(session, session_id, next_token)

    def end(self, session_id: str) -> None:
        """End one session."""
        with self._record.write() as unit:
            self._end(unit, session_id)

    def end_all_of(self, unit: UnitOfWork, name: str, but: str | None = None) -> None:
        """End all sessions of a user, with the transaction; `but` is one that goes on."""
        of_user = SESSIONS.c.user_name == name
        unit.change(delete(SESSIONS).where(of_user if but is None else of_user & (SESSIONS.c.id != but)))
        unit.after_commit(lambda: self._forget(lambda one, session: session.user.name == name and one != but))

    def _kept(self) -> dict[str, _Session]:
        """Sessions of before a restart: their access tokens are gone, their refresh tokens are good."""
        now_ns, now_s = self._clock.unix_ns(), self._clock.monotonic_s()
        query = select(SESSIONS, USERS.c.name, USERS.c.roles_json).join(USERS)
        found = self._record.rows(query.where(SESSIONS.c.ends_at_ns > now_ns, USERS.c.disabled.is_(False)))
        return {
            row["id"]: _Session(
                User(row["name"], roles_of_json(row["roles_json"]), Authenticated(row["authenticated_by"]), row["id"]),
                now_s + min((row["ends_at_ns"] - now_ns) / _NS, SESSION_S),
            )
            for row in found
        }

    def _session_of(self, refresh_token: str) -> tuple[str, bool]:
        """The session that a refresh token belongs to, and whether it was used; an empty id where there is none."""
        rows = self._record.rows(select(REFRESH_TOKENS).where(REFRESH_TOKENS.c.sha256 == _sha256(refresh_token)))
        return (rows[0]["session_id"], bool(rows[0]["used"])) if rows else ("", False)

    def _end(self, unit: UnitOfWork, session_id: str) -> None:
        """With the commit, so that nothing is recorded of the session after it."""
        unit.change(delete(SESSIONS).where(SESSIONS.c.id == session_id))
        unit.after_commit(lambda: self._forget(lambda one, _: one == session_id))

    def _note_reuse(self, unit: UnitOfWork, session_id: str, session: _Session) -> None:
        self._end(unit, session_id)
        user = session.user
        note_change(unit, user.name, AccountChange.REFRESH_TOKEN_REUSED, user.roles, "gateway")

    def _issued(self, session: _Session, session_id: str, refresh_token: str) -> Tokens:
        access_token, now_s = _new_token(), self._clock.monotonic_s()
        with self._lock:
            # An expired one is kept until its own session has a newer: its holder is told to renew it, not to sign in.
            newest = {access.session_id: sha256 for sha256, access in self._accesses.items()}
            newest[session_id] = ""
            known = {
                sha256: access
                for sha256, access in self._accesses.items()
                if access.ends_s > now_s or (newest[access.session_id] == sha256 and self.is_open(access.session_id))
            }
            self._accesses = {**known, _sha256(access_token): _Access(session_id, now_s + ACCESS_TOKEN_S)}
        return Tokens(session.user, access_token, refresh_token, ACCESS_TOKEN_S, session.ends_s - now_s)

    def _publish(self, session_id: str, session: _Session) -> None:
        with self._lock:
            self._sessions = {**self._open_ones(), session_id: session}

    def _forget(self, is_meant: Callable[[str, _Session], bool]) -> None:
        with self._lock:
            self._sessions = {one: session for one, session in self._sessions.items() if not is_meant(one, session)}
            self._accesses = {
                sha256: access for sha256, access in self._accesses.items() if access.session_id in self._sessions
            }
        self._on_end()

    def _open_ones(self) -> dict[str, _Session]:
        now_s = self._clock.monotonic_s()
        return {one: session for one, session in self._sessions.items() if session.ends_s > now_s}


def _keep(unit: UnitOfWork, session_id: str, refresh_token: str) -> None:
    unit.change(insert(REFRESH_TOKENS).values(sha256=_sha256(refresh_token), session_id=session_id, used=False))


def _new_token() -> str:
    return secrets.token_urlsafe(_TOKEN_BYTES)


def _sha256(token: str) -> str:
    """Tokens are random, so that a plain hash keeps them; passwords are not, and have another (`passwords`)."""
    return hashlib.sha256(token.encode()).hexdigest()
