"""`distalock pki`: the authority of an installation, and a key and certificate for each service."""

import argparse
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from distalock.arguments import EXIT_BAD_INPUT, named_path
from distalock.processes import taken_folder
from shared.errors import ConfigurationError
from shared.pki.keystore import FOLDER, NAMES, Entry, Keystore, Standing

EXIT_GOOD, EXIT_ATTENTION = 0, 3
RESTART: Final = "Start the installation again: a running service keeps the certificate that it started with."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    init = _action(actions, "init", "make what is missing, and renew what ends within half a year", _init)
    _add_host_names(init)
    issue = _action(actions, "issue", "a new key and certificate for some services, from the same authority", _issue)
    issue.add_argument("names", nargs="+", choices=NAMES, metavar="NAME", help=f"one or more of {', '.join(NAMES)}")
    _add_host_names(issue)
    _action(actions, "show", "who has which certificate, and until when", _show)
    rotate = _action(actions, "rotate", "a new authority and all certificates: no other is accepted any more", _rotate)
    _add_host_names(rotate)


def run(given: argparse.Namespace) -> int:
    """Run the action; the exit code is 3 when `show` found something to be done."""
    try:
        return int(given.run_pki(given))
    except ConfigurationError as error:
        print(f"distalock pki: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT


def _action(
    actions: "argparse._SubParsersAction[argparse.ArgumentParser]",
    name: str,
    summary: str,
    act: Callable[[argparse.Namespace], int],
) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = actions.add_parser(name, help=summary, description=summary)
    parser.add_argument("--state", type=named_path, default=Path("state"), help="state folder of the installation")
    parser.set_defaults(run_pki=act)
    return parser


def _add_host_names(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--router-host",
        action="append",
        default=[],
        metavar="NAME",
        help="a further name or address under which services reach the router; repeatable",
    )


def _init(given: argparse.Namespace) -> int:
    return _changed(given, lambda keystore, now: keystore.ensure(now, given.router_host))


def _issue(given: argparse.Namespace) -> int:
    return _changed(given, lambda keystore, now: keystore.issue(given.names, now, given.router_host))


def _rotate(given: argparse.Namespace) -> int:
    return _changed(given, lambda keystore, now: keystore.rotate(now, given.router_host))


def _changed(given: argparse.Namespace, change: Callable[[Keystore, datetime], Sequence[str]]) -> int:
    """Change the folder of an installation that does not run: half of one could not speak with the other half."""
    keystore, now = Keystore(given.state / FOLDER), datetime.now(UTC)
    with closing(taken_folder(given.state / "logs")):
        new = change(keystore, now)
    for line in report(keystore, now, new):
        print(line)
    if new:
        print(RESTART)
    return EXIT_GOOD


def _show(given: argparse.Namespace) -> int:
    keystore, now = Keystore(given.state / FOLDER), datetime.now(UTC)
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
