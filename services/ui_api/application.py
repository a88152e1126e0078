"""The gateway's application: everything but the stop and the heartbeat. The front starts it; see `front`."""

import argparse
import os
import socket
import sys
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from fastapi import FastAPI

from services.ui_api.app import make_app
from services.ui_api.front.admission import raised_handle_limit
from services.ui_api.front_link import FrontLink
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.stop import StopOutcome
from services.ui_api.link_messages import FrontFigures
from services.ui_api.routes.metrics import Metrics
from services.ui_api.server import serving
from services.ui_api.service import Gateway, open_gateway
from services.ui_api.settings import UiApiSettings
from shared.arguments import OneLineParser
from shared.bus.port import Bus
from shared.memory import share_arenas
from shared.runtime.lifecycle import Runtime, reporting, run_service
from shared.runtime.settings import ServiceSettings, load_settings

# Than the front, the robot and the router, on a machine that has not enough of processors for all.
_LESS_URGENT: Final = 5
# A thread that wants to go on waits that long for one that computes. Python's own is 5 ms, and a motion passes through
# a dozen such places on its way from the request to the robot. Chosen: ten times as often.
_THREADS_TAKE_TURNS_S: Final = 0.0005


class FrontRecording:
    """What the application does with what the front tells it: see `front_link.Recording`."""

    def __init__(self, gateway: Gateway, app: FastAPI) -> None:
        self._gateway = gateway
        self._metrics: Metrics = app.state.metrics

    def note_stop_begun(self) -> None:
        """Keep commands that wait from being sent."""
        self._gateway.stops.note_other()

    def record_stop(self, outcome: StopOutcome, reason: str, who: str) -> "Future[None]":
        """Hand a stop to the recorder."""
        return self._gateway.stop_recorder.put(outcome, reason, who)

    def note_stop(self, outcome: StopOutcome, took_s: float) -> None:
        """Count it among the requests."""
        self._metrics.note_stop(confirmed=outcome.confirmed, took_s=took_s)

    def note_front(self, figures: FrontFigures) -> None:
        """Show them among the metrics; what the front is short of impairs the gateway."""
        self._metrics.front = figures
        self._gateway.status.impair("front", figures.lacking)


def end_streams(gateway: Gateway) -> None:
    """Send everybody who watches home: events and live pictures."""
    gateway.feed.close()
    gateway.live.feed.close()


def main(arguments: list[str]) -> int:
    """Exit code: as of every service."""
    given = _parser().parse_args(arguments)
    raised_handle_limit()
    os.nice(_LESS_URGENT)
    sys.setswitchinterval(_THREADS_TAKE_TURNS_S)
    settings = load_settings(UiApiSettings, state_dir=given.state_dir)
    with (
        socket.socket(fileno=given.link) as line,
        socket.socket(fileno=given.listening) as listening,
        socket.socket(fileno=given.streams) as handed_on,
    ):
        return _run(settings, Inherited(line, listening, handed_on), given.boot_epoch)


@dataclass(frozen=True, slots=True)
class Inherited:
    """Sockets that the front has handed over: the link, where requests come in, and where connections do."""

    line: socket.socket
    listening: socket.socket
    handed_on: socket.socket


def _run(settings: UiApiSettings, inherited: Inherited, boot_epoch: str) -> int:
    links: list[FrontLink] = []

    @contextmanager
    def showing(_: Bus, runtime: Runtime, settings: ServiceSettings) -> Iterator[None]:
        """Heartbeats go to the front, which sends the gateway's own on the bus."""
        links.append(FrontLink(inherited.line, runtime.stop.set))
        with reporting(runtime, settings), links[0].beating():
            yield

    @contextmanager
    def compose(bus: Bus, runtime: Runtime) -> Iterator[None]:
        def early_end() -> None:
            runtime.fail("the HTTP server ended by itself")

        with open_gateway(bus, runtime, settings, Clock()) as gateway:
            app = make_app(gateway, settings.allowed_hosts, settings.cors_origins, settings.virtual_room_url)
            with serving(app, inherited.listening, early_end, inherited.handed_on) as streams:
                links[0].streams = streams
                links[0].listen(FrontRecording(gateway, app))
                yield
                end_streams(gateway)  # now, or the server would wait for them

    return run_service("ui_api", settings, compose, showing=showing, boot_epoch=boot_epoch)


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(prog="python -m services.ui_api.application", description=__doc__)
    parser.add_argument("--link", type=int, required=True, help="inherited socket: the link to the front")
    parser.add_argument("--listening", type=int, required=True, help="inherited socket: where requests come in")
    parser.add_argument(
        "--streams", type=int, required=True, help="inherited socket: where connections are handed over"
    )
    parser.add_argument("--boot-epoch", required=True, help="the gateway's run, which both processes name")
    parser.add_argument("--state-dir", type=Path, help="folder for the case record and the images")
    return parser


if __name__ == "__main__":
    share_arenas()
    sys.exit(main(sys.argv[1:]))
