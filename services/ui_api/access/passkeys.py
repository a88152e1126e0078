"""Passkeys (WebAuthn): what an approval can be shown with in place of a password.

A passkey signs a challenge that was made for one user and one plan, within two minutes and once: what it signs is the
consent to that plan. It lives in a phone, a security key or the console's own chip, and asks for a finger or a PIN
before it signs (user verification), so that a session that somebody left open approves nothing.
"""

import hmac
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from fido2.server import Fido2Server
from fido2.utils import websafe_encode
from fido2.webauthn import (
    AttestedCredentialData,
    AuthenticationResponse,
    PublicKeyCredentialRpEntity,
    PublicKeyCredentialUserEntity,
    ResidentKeyRequirement,
    UserVerificationRequirement,
)
from sqlalchemy import RowMapping, delete, insert, select, update

from services.ui_api.access.accounts import Accounts, note_change
from services.ui_api.core.account_event_data import AccountChange
from services.ui_api.core.identity import User
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.refusals import conflict, forbidden, unknown
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.tables import PASSKEYS
from services.ui_api.record.unit_of_work import UnitOfWork

# Chosen: long enough to find the phone; ten are more than anybody has.
CHALLENGE_S: Final = 120.0
MOST_OF_ONE_USER: Final = 10
_NAME: Final = "distalock"


@dataclass(frozen=True, slots=True)
class Passkey:
    """A passkey of an account. `uses` is the authenticator's own counter; 0 where it keeps none."""

    id: str
    user_name: str
    label: str
    public_credential: bytes
    uses: int
    created_at_ns: int


@dataclass(frozen=True, slots=True)
class _Pending:
    """A challenge that waits for its signature; `purpose` is a plan's hash, or empty for a new passkey."""

    state: Any
    purpose: str
    ends_s: float


class Passkeys:
    """Registers passkeys and verifies what they sign.

    Parameters
    ----------
    host
        Name under which browsers call the gateway: passkeys are bound to it.
    """

    def __init__(self, record: CaseRecord, accounts: Accounts, clock: Clock, host: str) -> None:
        self._record, self._accounts, self._clock = record, accounts, clock
        self._server = Fido2Server(PublicKeyCredentialRpEntity(id=host, name=_NAME), attestation=None)
        self._lock = threading.Lock()
        self._pending: dict[str, _Pending] = {}

    def of(self, name: str) -> list[Passkey]:
        """The passkeys of a user, the oldest first."""
        query = select(PASSKEYS).where(PASSKEYS.c.user_name == name).order_by(PASSKEYS.c.created_at_ns)
        return [_passkey(row) for row in self._record.rows(query)]

    def registration(self, user: User) -> dict[str, Any]:
        """Options for `navigator.credentials.create`; raises `Refused`."""
        account, known = self._accounts.account(user.name), self.of(user.name)
        if len(known) >= MOST_OF_ONE_USER:
            raise conflict(
                "too_many_passkeys",
                f"'{user.name}' has {len(known)} passkeys (limit {MOST_OF_ONE_USER}); remove one that is not used",
            )
        options, state = self._server.register_begin(
            PublicKeyCredentialUserEntity(id=account.name.encode(), name=account.name, display_name=account.name),
            [_credential(one) for one in known],
            resident_key_requirement=ResidentKeyRequirement.DISCOURAGED,
            user_verification=UserVerificationRequirement.REQUIRED,
        )
        self._put(user, state, "")
        return dict(options.public_key)

    def made(self, user: User, label: str, response: Mapping[str, Any]) -> Passkey:
        """A new passkey that answers the challenge, to be added; raises `Refused`."""
        pending = self._take(user, "")
        try:
            made = self._server.register_complete(pending.state, response)
        except (ValueError, KeyError, TypeError) as error:
            raise forbidden("passkey_invalid", f"the passkey was not taken ({_sentence(error)}); begin anew") from error
        credential = made.credential_data
        assert credential is not None  # checked by `register_complete`
        passkey_id = websafe_encode(credential.credential_id)
        return Passkey(passkey_id, user.name, label, bytes(credential), made.counter, self._clock.unix_ns())

    def add(self, unit: UnitOfWork, passkey: Passkey) -> None:
        """Keep a new passkey; raises `Refused`."""
        if self._record.rows(select(PASSKEYS).where(PASSKEYS.c.id == passkey.id)):
            raise conflict("passkey_exists", "this passkey is registered already; use it, or make another one")
        unit.change(
            insert(PASSKEYS).values(
                id=passkey.id,
                user_name=passkey.user_name,
                label=passkey.label,
                public_credential=passkey.public_credential,
                uses=passkey.uses,
                created_at_ns=passkey.created_at_ns,
            )
        )
        roles = self._accounts.account(passkey.user_name).roles
        note_change(unit, passkey.user_name, AccountChange.PASSKEY_ADDED, roles, passkey.user_name)

    def remove(self, unit: UnitOfWork, name: str, passkey_id: str, who: str) -> None:
        """Forget one passkey of a user; raises `Refused`."""
        if all(one.id != passkey_id for one in self.of(name)):
            raise unknown("passkey", passkey_id[:64], "GET /users/me/passkeys lists them")
        unit.change(delete(PASSKEYS).where(PASSKEYS.c.id == passkey_id))
        note_change(unit, name, AccountChange.PASSKEY_REMOVED, self._accounts.account(name).roles, who)

    def remove_all(self, unit: UnitOfWork, name: str, who: str) -> None:
        """Forget all passkeys of a user: a phone was lost; raises `Refused`."""
        account = self._accounts.account(name)
        if self.of(name):
            unit.change(delete(PASSKEYS).where(PASSKEYS.c.user_name == name))
            note_change(unit, name, AccountChange.PASSKEY_REMOVED, account.roles, who)

    def challenge(self, user: User, plan_sha256: str) -> dict[str, Any]:
        """Options for `navigator.credentials.get`, for the approval of one plan; raises `Refused`."""
        known = self.of(user.name)
        if not known:
            raise conflict("no_passkey", f"'{user.name}' has no passkey; register one, or approve with the password")
        options, state = self._server.authenticate_begin(
            [_credential(one) for one in known], user_verification=UserVerificationRequirement.REQUIRED
        )
        self._put(user, state, plan_sha256)
        return dict(options.public_key)

    def confirm(self, user: User, plan_sha256: str, response: Mapping[str, Any]) -> None:
        """Refuse unless a passkey of the user has signed the challenge for this plan; raises `Refused`."""
        pending = self._take(user, plan_sha256)
        known = self.of(user.name)
        try:
            signed = self._server.authenticate_complete(pending.state, [_credential(one) for one in known], response)
            uses = AuthenticationResponse.from_dict(response).response.authenticator_data.counter
        except (ValueError, KeyError, TypeError) as error:
            raise forbidden("credential_wrong", f"the passkey does not confirm it ({_sentence(error)})") from error
        passkey = next(one for one in known if one.id == websafe_encode(signed.credential_id))
        if (uses or passkey.uses) and uses <= passkey.uses:
            raise forbidden(
                "passkey_copied",
                f"passkey '{passkey.label}' counts {uses} uses and has counted {passkey.uses} before: there is a copy "
                "of it; remove it",
            )
        with self._record.write() as unit:
            unit.change(update(PASSKEYS).where(PASSKEYS.c.id == passkey.id).values(uses=uses))

    def _put(self, user: User, state: Any, purpose: str) -> None:
        """Remember a challenge; the user's one before is void."""
        now_s = self._clock.monotonic_s()
        with self._lock:
            good = {name: one for name, one in self._pending.items() if one.ends_s > now_s}
            self._pending = {**good, _holder(user): _Pending(state, purpose, now_s + CHALLENGE_S)}

    def _take(self, user: User, purpose: str) -> _Pending:
        """The challenge of this session, once; raises `Refused`."""
        with self._lock:
            pending = self._pending.pop(_holder(user), None)
        if pending is None or pending.ends_s <= self._clock.monotonic_s():
            raise forbidden(
                "challenge_missing", f"no challenge of the last {CHALLENGE_S:g} s waits for this; ask for a new one"
            )
        if not hmac.compare_digest(pending.purpose, purpose):
            raise forbidden("challenge_of_another_plan", "the challenge was for something else; ask for a new one")
        return pending


def _holder(user: User) -> str:
    return f"{user.name} {user.session_id or ''}"


def _sentence(error: Exception) -> str:
    return str(error).rstrip(".")[:200] or type(error).__name__


def _credential(passkey: Passkey) -> AttestedCredentialData:
    return AttestedCredentialData(passkey.public_credential)


def _passkey(row: RowMapping) -> Passkey:
    return Passkey(
        id=row["id"],
        user_name=row["user_name"],
        label=row["label"],
        public_credential=bytes(row["public_credential"]),
        uses=row["uses"],
        created_at_ns=row["created_at_ns"],
    )
