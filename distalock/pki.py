"""`distalock pki`: the authority of an installation, and a key and certificate for each service."""

import argparse
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from distalock.arguments import EXIT_BAD_INPUT
from distalock.processes import taken_folder
from shared.bus.tls import PKI_FOLDER
from shared.errors import ConfigurationError
from shared.pki.keystore import Entry, Keystore, Standing
from shared.pki.network import network_keystore

EXIT_GOOD, EXIT_ATTENTION = 0, 3
RESTART: Final = "Start the installation again: a running service keeps the certificate that it started with."


def run(given: argparse.Namespace) -> int:
    """Run the action; the exit code is 3 when `show` found something to be done."""
    stores = _stores(given.state / PKI_FOLDER)
    try:
        match given.action:
            case "init":
                changed = [(one, lambda store, now, hosts: store.ensure(now, hosts)) for one in stores]
                return _changed(given, changed)
            case "issue":
                return _changed(given, [(one, _issuing(given.names)) for one in _knowing(stores, given.names)])
            case "rotate":
                chosen = [one for one in stores if given.only in (None, one.option)]
                return _changed(given, [(one, lambda store, now, hosts: store.rotate(now, hosts)) for one in chosen])
            case _:
                return _show(stores)
    except ConfigurationError as error:
        print(f"distalock pki: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT


@dataclass(frozen=True, slots=True)
class Store:
    """An authority with what it signs.

    Attributes
    ----------
    option
        Its name on the command line, which also names the option for further host names.
    """

    option: str
    keystore: Keystore


Change = Callable[[Keystore, datetime, Sequence[str]], Sequence[str]]


def _stores(folder: Path) -> tuple[Store, ...]:
    return Store("bus", Keystore(folder)), Store("network", network_keystore(folder))


def _knowing(stores: Sequence[Store], names: Sequence[str]) -> list[Store]:
    """The stores that the names belong to; the first one refuses a name that nobody has."""
    found = [store for store in stores if store.keystore.holders.keys() & set(names)]
    known = set().union(*(store.keystore.holders for store in stores))
    if unknown := sorted(set(names) - known):
        everybody = ", ".join(name for store in stores for name in store.keystore.holders)
        raise ConfigurationError(f"nobody is called '{unknown[0]}' here; known are {everybody}")
    return found


def _issuing(names: Sequence[str]) -> Change:
    return lambda store, now, hosts: store.issue([name for name in names if name in store.holders], now, hosts)


def _changed(given: argparse.Namespace, changes: Sequence[tuple[Store, Change]]) -> int:
    """Change the folder of an installation that does not run: half of one could not speak with the other half."""
    now = datetime.now(UTC)
    hosts = {"bus": given.router_host, "network": given.network_host}
    with closing(taken_folder(given.state / "logs")):
        new = [(store, change(store.keystore, now, hosts[store.option])) for store, change in changes]
    for store, names in new:
        for line in report(store.keystore, now, names):
            print(line)
    if any(names for _, names in new):
        print(RESTART)
    return EXIT_GOOD


def _show(stores: Sequence[Store]) -> int:
    now = datetime.now(UTC)
    for store in stores:
        for line in report(store.keystore, now):
            print(line)
    entries = [entry for store in stores for entry in store.keystore.entries(now)]
    return EXIT_GOOD if all(entry.standing is Standing.VALID for entry in entries) else EXIT_ATTENTION


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
