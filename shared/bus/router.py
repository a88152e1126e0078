"""The router as a Python process: `python -m shared.bus.router [--room or1] [--listen tls/127.0.0.1:7447]`.

With `--site or1,or2` it is the hospital's, to which rooms show themselves (`shared.bus.site`), instead of one room's.

A session opened with ``mode: router`` is a full Zenoh router, with no Python in the data path. It takes links under
mutual TLS alone, lets through what the access table allows, and reports what it refuses (`refusal_watch`).
`--plain-bus` is the one way around, with a warning: anybody who reaches the port may then say anything.
"""

import argparse
import json
import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

import zenoh

from shared.arguments import OneLineParser
from shared.bus.access import CLIENTS, Row, access_table
from shared.bus.access_rules import access_control
from shared.bus.keys import Keys
from shared.bus.refusal_watch import captured_log, watched
from shared.bus.router_log import NEEDED_TARGETS
from shared.bus.shared_memory import unlock_pools
from shared.bus.site import require_room_names, site_clients, site_refusals_key, site_table
from shared.bus.tls import PLAIN_BUS_WARNING, SCHEME, TlsFiles
from shared.errors import ConfigurationError
from shared.memory import share_arenas
from shared.scheduling import keep_collections_short, take_precedence
from shared.signals import set_by_signals
from shared.threads import faults_go_to

# The services end first; the robot's locks the hexapod and says so.
LINGER_S: Final = 5.0
# No sender of frames starts twice within it.
_UNLOCK_EVERY_S: Final = 0.5
DEFAULT_CONFIG = Path(__file__).with_name("router.json5")
_ERRORS: Final = "error"
_RUST_LOG: Final = "RUST_LOG"


@dataclass(frozen=True, slots=True)
class Protection:
    """What the router lets in.

    Attributes
    ----------
    tls
        The router's own certificate, and the authority whose clients it takes links from.
    table
        The only keys that there are, and who may do what with them.
    clients
        Common names of those who may do something.
    refusals_key
        Where it publishes what it has refused.
    """

    tls: TlsFiles
    table: tuple[Row, ...]
    clients: tuple[str, ...]
    refusals_key: str

    @classmethod
    def of_room(cls, tls: TlsFiles, room: str) -> Self:
        """Of the router of one operating room."""
        keys = Keys(room)
        return cls(tls, access_table(keys), CLIENTS, keys.bus_refusals)

    @classmethod
    def of_site(cls, tls: TlsFiles, rooms: Sequence[str]) -> Self:
        """Of the router to which rooms show themselves; raises `ConfigurationError` for a name that none can have."""
        require_room_names(rooms)
        return cls(tls, site_table(rooms), site_clients(rooms), site_refusals_key())


@contextmanager
def running_router(config: zenoh.Config) -> Iterator[zenoh.Session]:
    """A router for as long as the context lasts.

    Raises
    ------
    ConfigurationError
        When an endpoint is in use, or the configuration cannot be used.
    """
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise ConfigurationError(_why_not_open(_endpoints(config), error)) from error
    with session:
        yield session


def router_config(config_file: Path, listen: Sequence[str], protection: Protection | None) -> zenoh.Config:
    """Configuration of a router.

    Parameters
    ----------
    config_file
        Zenoh configuration in JSON5.
    listen
        Endpoints that replace those of the file, when given.
    protection
        None for a router that takes anybody.

    Raises
    ------
    ConfigurationError
        When the file or a certificate cannot be used, or an endpoint is without TLS although there is protection.
    """
    try:
        config = zenoh.Config.from_file(config_file)
        if listen:
            config.insert_json5("listen/endpoints", json.dumps(list(listen)))
        for key, value in (_protected(protection) if protection is not None else {}).items():
            config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise ConfigurationError(f"router configuration {config_file} cannot be used: {_first_line(error)}") from error
    if protection is not None:
        _require_tls(_endpoints(config))
    return config


def _protected(protection: Protection) -> dict[str, object]:
    protection.tls.require()
    return {
        "transport/link/tls/root_ca_certificate": str(protection.tls.authority),
        "transport/link/tls/listen_certificate": str(protection.tls.certificate),
        "transport/link/tls/listen_private_key": str(protection.tls.key),
        "transport/link/tls/enable_mtls": True,
        "transport/link/tls/close_link_on_expiration": True,
        "access_control": access_control(protection.table, protection.clients),
    }


def _require_tls(endpoints: Sequence[str]) -> None:
    for endpoint in endpoints:
        if not endpoint.startswith(SCHEME):
            raise ConfigurationError(
                f"{endpoint} is without TLS: anybody could speak as any service; listen at {SCHEME}... "
                "or say so (--plain-bus)"
            )


def _endpoints(config: zenoh.Config) -> list[str]:
    found: list[str] = json.loads(config.get_json("listen/endpoints"))
    return found


def _why_not_open(endpoints: Sequence[str], error: zenoh.ZError) -> str:
    where = ", ".join(endpoints)
    if "Address already in use" in str(error):
        return f"{where} is in use by another program; stop it or listen elsewhere (--listen tls/127.0.0.1:PORT)"
    return f"the router cannot listen at {where}: {_first_line(error)}"


def _first_line(error: zenoh.ZError) -> str:
    return " ".join(str(error).split()).split(" at /")[0]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGTERM or SIGINT; 0 after a clean end, 1 after a fault, 2 when the router cannot start."""
    given = _parser().parse_args(arguments)
    stop = threading.Event()
    faults = _Faults(stop)
    os.environ.setdefault("NO_COLOR", "1")
    try:
        protection = None if given.plain_bus else _protection(given)
        config = router_config(given.config, given.listen, protection)
        if given.print_config:
            print(config)  # noqa: T201 - this is what was asked for
            return 0
        with faults_go_to(faults), set_by_signals(stop, LINGER_S):
            if protection is None:
                _run_plain(config, stop)
            else:
                _run_watched(config, protection, stop)
    except ConfigurationError as error:
        print(f"router: {error}", file=sys.stderr)  # noqa: T201 - the one sentence for the person at the terminal
        return 2
    return int(faults.seen)


class _Faults:
    """A loop of this process that has ended ends the process: nothing is refused without being on record."""

    def __init__(self, stop: threading.Event) -> None:
        self._stop = stop
        self.seen = False

    def fail(self, message: str) -> None:
        """See `FaultListener`."""
        print(f"router: {message}; it ends", file=sys.stderr)  # noqa: T201 - the last line of its log
        self.seen = True
        self._stop.set()

    def note_error(self, place: str, error: BaseException) -> None:
        """See `FaultListener`; the error is logged already."""


def _run_plain(config: zenoh.Config, stop: threading.Event) -> None:
    print(f"router: warning: {PLAIN_BUS_WARNING}", file=sys.stderr)  # noqa: T201 - for the terminal
    zenoh.init_log_from_env_or(_ERRORS)
    with running_router(config):
        _wait(stop)


def _run_watched(config: zenoh.Config, protection: Protection, stop: threading.Event) -> None:
    """What is refused goes to the log, and on the bus to the gateway; the router's own messages pass no rules."""
    os.environ[_RUST_LOG] = f"{os.environ.get(_RUST_LOG, _ERRORS)},{NEEDED_TARGETS}"
    zenoh.init_log_from_env_or(_ERRORS)
    key = protection.refusals_key
    with (
        captured_log() as log,
        running_router(config) as session,
        watched(log, str(session.info.zid()), lambda message: session.put(key, message), protection.clients),
    ):
        _wait(stop)


def _wait(stop: threading.Event) -> None:
    """Wait for the end; what Zenoh has mapped until then is unlocked."""
    unlock_pools()
    while not stop.wait(_UNLOCK_EVERY_S):
        unlock_pools()


def _parser() -> OneLineParser:
    parser = OneLineParser(prog="python -m shared.bus.router", description="The message router of one operating room.")
    parser.add_argument("--config", type=Path, default=DEFAULT_CONFIG, help="Zenoh configuration, JSON5")
    parser.add_argument("--listen", action="append", default=[], help="endpoint, e.g. tls/127.0.0.1:7447; repeatable")
    room = os.environ.get("DISTALOCK_ROOM", "or1")
    parser.add_argument("--room", default=room, help="operating room: part of every key (DISTALOCK_ROOM, or1)")
    parser.add_argument("--site", metavar="ROOM,ROOM", help="be the router to which these rooms show themselves")
    for name in ("authority", "certificate", "key"):
        variable = f"DISTALOCK_TLS_{name.upper()}"
        file = os.environ.get(variable)
        parser.add_argument(f"--{name}", type=Path, default=file, help=f"file in PEM ({variable})")
    parser.add_argument("--plain-bus", action="store_true", help="no TLS and no access control; prints a warning")
    parser.add_argument(
        "--print-config", action="store_true", help="print the whole configuration, for zenohd, and end"
    )
    return parser


def _protection(given: argparse.Namespace) -> Protection:
    for name in ("authority", "certificate", "key"):
        if getattr(given, name) is None:
            raise ConfigurationError(
                f"no --{name} is given: name the router's files, which `distalock pki init` makes, or say that you "
                "want none (--plain-bus)"
            )
    tls = TlsFiles(given.authority, given.certificate, given.key)
    return Protection.of_room(tls, given.room) if given.site is None else Protection.of_site(tls, given.site.split(","))


if __name__ == "__main__":
    take_precedence()
    keep_collections_short()
    share_arenas()
    sys.exit(main())
