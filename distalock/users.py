"""`distalock users`: accounts of an installation that does not run. While it runs, administrators use REST.

The log has one writer, which numbers its entries; changes of accounts stand in it.
"""

import argparse
import getpass
import os
import re
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from distalock.arguments import EXIT_BAD_INPUT
from services.ui_api.access.accounts import Account, Accounts
from services.ui_api.access.passwords import Passwords
from services.ui_api.core.account_rules import USER_NAME_PATTERN
from services.ui_api.core.roles import Role
from services.ui_api.record.database import existing_database, open_database, sole_gateway
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.tables import SESSIONS
from services.ui_api.record.unit_of_work import UnitOfWork
from services.ui_api.settings import UiApiSettings
from shared.errors import DistalockError, InputError
from shared.runtime.settings import load_settings

Change = Callable[[UnitOfWork, Accounts, str], str]
"""Changes something in the name of somebody; returns one line that reports it."""


def run(given: argparse.Namespace) -> int:
    """Run the action; 0 when it is done."""
    try:
        settings = load_settings(UiApiSettings, state_dir=given.state.resolve(), database_url=given.database)
        if given.action == "list":
            return _list(settings.record_url())
        if re.fullmatch(USER_NAME_PATTERN, given.name) is None:
            raise InputError(
                f"{given.name!r} is no account's name: small letters, digits, '.', '_' and '-', 2 to 32, a letter first"
            )
        with _accounts(settings.record_url()) as (record, accounts):
            change = _CHANGES[given.action](given, accounts)
            with record.write() as unit:
                print(change(unit, accounts, _who()))
    except DistalockError as error:
        print(f"distalock users {given.action}: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    return 0


@contextmanager
def _accounts(url: str) -> Iterator[tuple[CaseRecord, Accounts]]:
    """The record, held against a gateway; a new one where there is none yet."""
    with sole_gateway(url):
        record = CaseRecord(open_database(url), time.time_ns)
        try:
            yield record, Accounts(record, Passwords())
        finally:
            record.close()


def _list(url: str) -> int:
    record = CaseRecord(existing_database(url), time.time_ns)
    for account in Accounts(record, Passwords()).all():
        print(f"{account.name}  {', '.join(sorted(account.roles))}{'  disabled' if account.disabled else ''}")
    record.close()
    return 0


def _add(given: argparse.Namespace, accounts: Accounts) -> Change:
    hashed, roles = accounts.hashed(given.name, _new_password(given)), _roles_of(given)

    def change(unit: UnitOfWork, accounts: Accounts, who: str) -> str:
        accounts.create(unit, Account(given.name, roles, hashed, disabled=False, created_at_ns=unit.now_ns), who)
        return f"{given.name} is there, as {', '.join(sorted(roles))}"

    return change


def _password(given: argparse.Namespace, accounts: Accounts) -> Change:
    accounts.account(given.name)
    hashed = accounts.hashed(given.name, _new_password(given))

    def change(unit: UnitOfWork, accounts: Accounts, who: str) -> str:
        accounts.set_password(unit, given.name, hashed, who)
        return _sessions_ended(unit, given.name, "has a new password")

    return change


def _roles(given: argparse.Namespace, _: Accounts) -> Change:
    def change(unit: UnitOfWork, accounts: Accounts, who: str) -> str:
        accounts.set_roles(unit, given.name, _roles_of(given), who)
        return _sessions_ended(unit, given.name, f"is {', '.join(sorted(_roles_of(given)))}")

    return change


def _disable(given: argparse.Namespace, _: Accounts) -> Change:
    def change(unit: UnitOfWork, accounts: Accounts, who: str) -> str:
        accounts.set_disabled(unit, given.name, who, disabled=True)
        return _sessions_ended(unit, given.name, "is disabled")

    return change


def _enable(given: argparse.Namespace, _: Accounts) -> Change:
    def change(unit: UnitOfWork, accounts: Accounts, who: str) -> str:
        accounts.set_disabled(unit, given.name, who, disabled=False)
        return f"{given.name} is enabled"

    return change


_CHANGES: Final[dict[str, Callable[[argparse.Namespace, Accounts], Change]]] = {
    "add": _add,
    "password": _password,
    "roles": _roles,
    "disable": _disable,
    "enable": _enable,
}


def _sessions_ended(unit: UnitOfWork, name: str, what: str) -> str:
    ended = unit.change(SESSIONS.delete().where(SESSIONS.c.user_name == name))
    return f"{name} {what}; {ended} sessions ended"


def _roles_of(given: argparse.Namespace) -> frozenset[Role]:
    return frozenset(Role(role) for role in given.roles)


def _new_password(given: argparse.Namespace) -> str:
    """From stdin, or asked for twice; never an argument, which other users of the machine can read."""
    if given.password_stdin:
        return sys.stdin.readline().rstrip("\n")
    password = getpass.getpass(f"new password of {given.name}: ")
    if getpass.getpass("once more: ") != password:
        raise InputError("the two passwords differ; try again")
    return password


def _who() -> str:
    """The system's user, because nobody is signed in."""
    return f"command line, user {os.getuid()}"
