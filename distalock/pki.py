"""`distalock pki`: the authority of an installation, and a key and certificate for each service."""

import argparse
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from datetime import UTC, datetime
from typing import Final

from distalock.arguments import EXIT_BAD_INPUT
from distalock.processes import taken_folder
from shared.bus.tls import PKI_FOLDER
from shared.errors import ConfigurationError
from shared.pki.keystore import Entry, Keystore, Standing

EXIT_GOOD, EXIT_ATTENTION = 0, 3
RESTART: Final = "Start the installation again: a running service keeps the certificate that it started with."


def run(given: argparse.Namespace) -> int:
    """Run the action; the exit code is 3 when `show` found something to be done."""
    try:
        match given.action:
            case "init":
                return _changed(given, lambda keystore, now: keystore.ensure(now, given.router_host))
            case "issue":
                return _changed(given, lambda keystore, now: keystore.issue(given.names, now, given.router_host))
            case "rotate":
                return _changed(given, lambda keystore, now: keystore.rotate(now, given.router_host))
            case _:
                return _show(given)
    except ConfigurationError as error:
        print(f"distalock pki: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT


def _changed(given: argparse.Namespace, change: Callable[[Keystore, datetime], Sequence[str]]) -> int:
    """Change the folder of an installation that does not run: half of one could not speak with the other half."""
    keystore, now = Keystore(given.state / PKI_FOLDER), datetime.now(UTC)
    with closing(taken_folder(given.state / "logs")):
        new = change(keystore, now)
    for line in report(keystore, now, new):
        print(line)
    if new:
        print(RESTART)
    return EXIT_GOOD


def _show(given: argparse.Namespace) -> int:
    keystore, now = Keystore(given.state / PKI_FOLDER), datetime.now(UTC)
    for line in report(keystore, now):
        print(line)
    good = all(entry.standing is Standing.VALID for entry in keystore.entries(now))
    return EXIT_GOOD if good else EXIT_ATTENTION


def report(keystore: Keystore, now: datetime, new: Sequence[str] = ()) -> list[str]:
    """The authority and each certificate, a line each.

    Raises
    ------
    ConfigurationError
        When there is no authority.
    """
    authority = keystore.authority_facts()
    rows = [_row(entry, now, "new" if entry.name in new else entry.standing) for entry in keystore.entries(now)]
    return [
        f"{authority.common_name}, until {authority.not_after:%Y-%m-%d}, SHA-256 {authority.fingerprint[:16]}…",
        *rows,
    ]


def _row(entry: Entry, now: datetime, standing: str) -> str:
    if entry.facts is None:
        return f"{entry.name:13}{standing}"
    facts = entry.facts
    names = f", reached as {', '.join(facts.host_names)}" if facts.host_names else ""
    days = (facts.not_after - now).days
    return (
        f"{entry.name:13}{standing}, until {facts.not_after:%Y-%m-%d} ({days} days), "
        f"SHA-256 {facts.fingerprint[:16]}…{names}"
    )
