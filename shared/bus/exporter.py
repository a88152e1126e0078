"""Shows one room to the hospital's control desk: `python -m shared.bus.exporter --site tls/site.example:7448 ...`.

A client of two routers. At the room's it receives and can do nothing else; at the site's it publishes one message and
receives nothing. Nothing of what is at the site reaches the room, whoever has taken it over; and the room does not
notice whether the site is there: this program is the only one that waits for it.
"""

import argparse
import os
import secrets
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final, TypeVar

from shared.arguments import OneLineParser
from shared.bus.access import SERVICES
from shared.bus.keys import Keys
from shared.bus.port import Bus, Publisher, Sample
from shared.bus.room_view import RobotGlance, RoomView
from shared.bus.settings import BusSettings
from shared.bus.site import require_room_names, summary_key
from shared.bus.tls import SCHEME, TlsFiles
from shared.bus.zenoh_bus import open_bus
from shared.errors import BusUnavailable, ConfigurationError
from shared.memory import share_arenas
from shared.messages.base import MessageModel, decode, encode
from shared.messages.cases import CaseContext
from shared.messages.presence import ServiceName, ServiceStatus
from shared.messages.refusals import BusRefusals
from shared.signals import set_by_signals

# Chosen: what people at a desk take for at once; and how often a room that does not change says that it is there.
LOOK_EVERY_S: Final = 0.2
REPEAT_EVERY_S: Final = 1.0
_OPEN_WITHIN_S: Final = 5.0
_AGAIN_AFTER_S: Final = 1.0
_LOWEST_PRIORITY: Final = 10

M = TypeVar("M", bound=MessageModel)


def receive_room(bus: Bus, keys: Keys, view: RoomView, clock_s: Callable[[], float]) -> None:
    """Subscribe to what the view is made of, at the room's router."""
    bus.subscribe_retained(keys.robot_state, _robot_glance(view, clock_s))
    bus.subscribe_retained(keys.case_context, _decoded(CaseContext, view.note_case))
    bus.subscribe(keys.bus_refusals, _decoded(BusRefusals, view.note_refusals))
    for service in SERVICES:
        bus.subscribe_retained(keys.status(service), _decoded(ServiceStatus, view.note_status))
        bus.presence().watch_alive(keys.alive(service), _noting(view, service))


def _robot_glance(view: RoomView, clock_s: Callable[[], float]) -> Callable[[Sample], None]:
    return lambda sample: view.note_robot(RobotGlance.model_validate_json(sample.payload), clock_s())


def _decoded(kind: type[M], note: Callable[[M], None]) -> Callable[[Sample], None]:
    return lambda sample: note(decode(kind, sample.payload))


def _noting(view: RoomView, service: ServiceName) -> Callable[[str, bool], None]:
    return lambda _key, alive: view.note_alive(service, alive=alive)


class Reporting:
    """Publishes the room's summary: at once when it changed, otherwise every second."""

    def __init__(self, view: RoomView, publisher: Publisher, clock_s: Callable[[], float]) -> None:
        self._view, self._publisher, self._clock_s = view, publisher, clock_s
        self._sent_at_s = float("-inf")

    def look(self, *, link_up: bool) -> bool:
        """Publish what is due; whether something was."""
        now_s = self._clock_s()
        summary = self._view.changed(now_s, link_up=link_up)
        if summary is None:
            if now_s - self._sent_at_s < REPEAT_EVERY_S:
                return False
            summary = self._view.summary(now_s, link_up=link_up)
        self._publisher.put(encode(summary))
        self._view.note_sent(summary)
        self._sent_at_s = now_s
        return True


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGTERM or SIGINT; 0 after a clean end, 2 when a file is missing."""
    given = _parser().parse_args(arguments)
    stop = threading.Event()
    try:
        require_room_names([given.room])
        room = BusSettings(given.router, _OPEN_WITHIN_S, _files(given))
        site = BusSettings(given.site, _OPEN_WITHIN_S, TlsFiles.in_folder(given.site_keys))
        os.nice(_LOWEST_PRIORITY)  # whatever the room computes goes first
        with set_by_signals(stop):
            _run(given.room, room, site, stop)
    except ConfigurationError as error:
        _say(f"{error}")
        return 2
    return 0


def _run(room: str, room_bus: BusSettings, site_bus: BusSettings, stop: threading.Event) -> None:
    view = RoomView(room, secrets.token_hex(8))
    with ExitStack() as sessions:
        here, there = _opened(room_bus, stop, sessions), _opened(site_bus, stop, sessions)
        if here is None or there is None:
            return
        receive_room(here, Keys(room), view, time.monotonic)
        reporting = Reporting(view, there.retained_publisher(summary_key(room)), time.monotonic)
        _say(f"room '{room}' is shown at {site_bus.endpoint}")
        while not stop.wait(LOOK_EVERY_S):
            reporting.look(link_up=here.presence().link_up())


def _opened(settings: BusSettings, stop: threading.Event, sessions: ExitStack) -> Bus | None:
    """A session at a router, however long that takes to come; None when this is to end."""
    said = False
    while not stop.is_set():
        try:
            return sessions.enter_context(open_bus(settings))
        except BusUnavailable as error:
            if not said:
                _say(f"{error}; trying again")
            said = True
        stop.wait(_AGAIN_AFTER_S)
    return None


def _files(given: argparse.Namespace) -> TlsFiles | None:
    """The room's files; None on a bus without TLS."""
    if not given.router.startswith(SCHEME):
        return None
    named = [given.authority, given.certificate, given.key]
    if any(file is None for file in named):
        raise ConfigurationError("--authority, --certificate and --key name the files that `distalock pki` has made")
    return TlsFiles(*named)


def _say(line: str) -> None:
    print(f"exporter: {line}", file=sys.stderr, flush=True)  # noqa: T201 - its log


def _parser() -> OneLineParser:
    parser = OneLineParser(prog="python -m shared.bus.exporter", description="Shows a room to the hospital's desk.")
    environment = os.environ.get
    room = environment("DISTALOCK_ROOM", "or1")
    parser.add_argument("--room", default=room, help="operating room (DISTALOCK_ROOM, or1)")
    router = environment("DISTALOCK_ROUTER_ENDPOINT", "tls/127.0.0.1:7447")
    parser.add_argument("--router", default=router, help="the room's router (DISTALOCK_ROUTER_ENDPOINT)")
    for name in ("authority", "certificate", "key"):
        variable = f"DISTALOCK_TLS_{name.upper()}"
        parser.add_argument(f"--{name}", type=Path, default=environment(variable), help=f"of the room ({variable})")
    site, keys = environment("DISTALOCK_SITE"), environment("DISTALOCK_SITE_KEYS")
    parser.add_argument("--site", default=site, required=site is None, help="the site's router (DISTALOCK_SITE)")
    parser.add_argument(
        "--site-keys",
        type=Path,
        default=None if keys is None else Path(keys),
        required=keys is None,
        metavar="FOLDER",
        help="folder of this room that `distalock site init` has made (DISTALOCK_SITE_KEYS)",
    )
    return parser


if __name__ == "__main__":
    share_arenas()
    sys.exit(main())
