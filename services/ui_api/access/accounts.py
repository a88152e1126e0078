"""Accounts in the record's database. Every change stands in the log, without the secret."""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Final

from sqlalchemy import RowMapping, insert, select, update

from services.ui_api.access.passwords import Passwords
from services.ui_api.core.account_event_data import AccountChange, AccountChanged
from services.ui_api.core.account_rules import name_refusal, password_refusal
from services.ui_api.core.events import EventDraft
from services.ui_api.core.identity import ProviderIdentity
from services.ui_api.core.roles import Role
from services.ui_api.handlers.refusals import Refused, conflict, forbidden, invalid, unauthenticated, unknown
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.tables import USERS
from services.ui_api.record.unit_of_work import UnitOfWork

# Of accounts of the identity provider: no password has this hash.
NO_PASSWORD: Final = "none"  # noqa: S105 - it opens nothing
EndSessions = Callable[[UnitOfWork, str], None]


@dataclass(frozen=True, slots=True)
class Account:
    """One account. `password_hash` never leaves this package."""

    name: str
    roles: frozenset[Role]
    password_hash: str
    disabled: bool
    created_at_ns: int
    provider_subject: str | None = None  # of an account of the identity provider


class Accounts:
    """Reads and changes accounts.

    Parameters
    ----------
    taken_names
        Names that no account may have, besides those of services.

    Attributes
    ----------
    on_create
        Called when an account was made, whoever made it.
    """

    def __init__(self, record: CaseRecord, passwords: Passwords, taken_names: Iterable[str] = ()) -> None:
        self._record, self._passwords = record, passwords
        self._taken_names = frozenset(taken_names)
        self.on_create: Callable[[], None] = lambda: None

    def find(self, name: str) -> Account | None:
        """The account of a name; None when there is none."""
        rows = self._record.rows(select(USERS).where(USERS.c.name == name))
        return _account(rows[0]) if rows else None

    def account(self, name: str) -> Account:
        """The account of a name; raises `Refused`."""
        found = self.find(name)
        if found is None:
            raise unknown("user", name, "GET /users lists them")
        return found

    def all(self) -> list[Account]:
        """All accounts, by name."""
        return [_account(row) for row in self._record.rows(select(USERS).order_by(USERS.c.name))]

    def are_there_none(self) -> bool:
        """Whether nobody has an account yet."""
        return not self._record.rows(select(USERS).limit(1))

    def hashed(self, name: str, password: str) -> str:
        """Hash of a new password; raises `Refused` when it is none. Slow: call it outside a transaction."""
        if (why := password_refusal(name, password)) is not None:
            raise invalid("password_refused", why)
        return self._passwords.hashed(password)

    def create(self, unit: UnitOfWork, account: Account, who: str) -> None:
        """Make an account; raises `Refused`."""
        why = name_refusal(account.name)
        if account.name in self._taken_names:
            why = f"the name '{account.name}' is the simulation's; choose another"
        if why is not None:
            raise invalid("user_name_refused", why)
        if self.find(account.name) is not None:
            raise conflict(
                "user_exists", f"there is a user '{account.name}' already; choose another name, or change it"
            )
        unit.change(
            insert(USERS).values(
                name=account.name,
                roles_json=_roles_json(account.roles),
                password_hash=account.password_hash,
                disabled=account.disabled,
                created_at_ns=unit.now_ns,
                provider_subject=account.provider_subject,
            )
        )
        note_change(unit, account.name, AccountChange.CREATED, account.roles, who)
        unit.after_commit(self.on_create)

    def unchanged(self, account: Account) -> Account:
        """The account as it is now, of somebody who has just shown who he is; raises `Refused` where that is past."""
        now = self.find(account.name)
        if now is None or now.disabled or now.password_hash != account.password_hash:
            raise login_failed()
        return now

    def of_provider(self, unit: UnitOfWork, identity: ProviderIdentity, end_sessions: EndSessions) -> Account:
        """The account of somebody whom the provider knows, made at the first time; raises `Refused`.

        Roles are those that the provider says now; sessions with other roles end.
        """
        rows = self._record.rows(select(USERS).where(USERS.c.provider_subject == identity.subject))
        if not rows:
            if identity.name_refusal is not None:
                raise forbidden("provider_name_unusable", identity.name_refusal)
            made = Account(identity.name, identity.roles, NO_PASSWORD, disabled=False, created_at_ns=unit.now_ns)
            made = replace(made, provider_subject=identity.subject)
            self.create(unit, made, identity.name)
            return made
        account = _account(rows[0])
        if account.disabled:
            raise forbidden("account_disabled", f"the account '{account.name}' is disabled; ask an administrator")
        return _with_roles(unit, account, identity.roles, end_sessions)

    def without_roles(self, unit: UnitOfWork, subject: str, end_sessions: EndSessions) -> None:
        """Take all roles back from the account of somebody whom the provider gives none, where he has an account."""
        for row in self._record.rows(select(USERS).where(USERS.c.provider_subject == subject)):
            _with_roles(unit, _account(row), frozenset(), end_sessions)

    def set_password(self, unit: UnitOfWork, name: str, password_hash: str, who: str) -> None:
        """Replace the password; raises `Refused`."""
        account = self.account(name)
        unit.change(update(USERS).where(USERS.c.name == name).values(password_hash=password_hash))
        note_change(unit, name, AccountChange.PASSWORD_CHANGED, account.roles, who)

    def set_roles(self, unit: UnitOfWork, name: str, roles: frozenset[Role], who: str) -> None:
        """Replace the roles; raises `Refused`."""
        account = self.account(name)
        if roles == account.roles:
            return
        if Role.ADMINISTRATOR not in roles:
            self._require_another_administrator(account, "lose that role")
        unit.change(update(USERS).where(USERS.c.name == name).values(roles_json=_roles_json(roles)))
        note_change(unit, name, AccountChange.ROLES_CHANGED, roles, who)

    def set_disabled(self, unit: UnitOfWork, name: str, who: str, *, disabled: bool) -> None:
        """Disable an account, or enable it again; raises `Refused`. Nothing deletes one: the log names it."""
        account = self.account(name)
        if disabled == account.disabled:
            return
        if disabled:
            self._require_another_administrator(account, "be disabled")
        unit.change(update(USERS).where(USERS.c.name == name).values(disabled=disabled))
        note_change(unit, name, AccountChange.DISABLED if disabled else AccountChange.ENABLED, account.roles, who)

    def _require_another_administrator(self, account: Account, consequence: str) -> None:
        if Role.ADMINISTRATOR not in account.roles or account.disabled:
            return
        others = [one for one in self.all() if one.name != account.name and not one.disabled]
        if not any(Role.ADMINISTRATOR in one.roles for one in others):
            raise conflict(
                "last_administrator",
                f"'{account.name}' is the only administrator and cannot {consequence}; make another one first",
            )


def login_failed() -> Refused:
    """The same for a wrong name, a wrong password and a disabled account: which it is, is nobody's business."""
    return unauthenticated(
        "login_failed", "name and password do not belong together; try again, or ask an administrator"
    )


def note_change(unit: UnitOfWork, name: str, change: AccountChange, roles: frozenset[Role], who: str) -> None:
    """Put a change of an account into the log."""
    unit.append(EventDraft(AccountChanged(name, change, tuple(sorted(roles))), None, who))


def _with_roles(unit: UnitOfWork, account: Account, roles: frozenset[Role], end_sessions: EndSessions) -> Account:
    """The account with the roles that the provider gives; sessions with others end."""
    if account.roles != roles:
        unit.change(update(USERS).where(USERS.c.name == account.name).values(roles_json=_roles_json(roles)))
        note_change(unit, account.name, AccountChange.ROLES_CHANGED, roles, "gateway")
        end_sessions(unit, account.name)
    return replace(account, roles=roles)


def roles_of_json(roles_json: str) -> frozenset[Role]:
    """Roles as the database has them."""
    return frozenset(Role(role) for role in json.loads(roles_json))


def _roles_json(roles: frozenset[Role]) -> str:
    return json.dumps(sorted(roles))


def _account(row: RowMapping) -> Account:
    return Account(
        name=row["name"],
        roles=roles_of_json(row["roles_json"]),
        password_hash=row["password_hash"],
        disabled=bool(row["disabled"]),
        created_at_ns=row["created_at_ns"],
        provider_subject=row["provider_subject"],
    )
