"""A composed installation as a procedure and a fault take hold of it."""

import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import httpx

from benchmarks.faults.acknowledged import Acknowledged, AcknowledgingClient
from benchmarks.faults.hexapod import Hexapod
from benchmarks.faults.watch import ReadinessWatch
from distalock.readiness import Server
from distalock.rest_client import RestClient
from distalock.room_client import RoomClient
from distalock.running_procedure import connection_to, wait_until_usable
from tools.containers.composition import Composition

ANSWER_S: Final = 180.0
_IMPATIENT_S: Final = 3.0
_READY_WITHIN_S: Final = 300.0
_DOCKER: Final = "/var/run/docker.sock"
_DOCKER_ANSWERS_WITHIN_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class ContainerHands:
    """The virtual operating room of a composed installation."""

    control: RestClient

    @property
    def room(self) -> RoomClient:
        """What hands do in it."""
        return RoomClient(self.control)


@dataclass(frozen=True, slots=True)
class ContainerSite:
    """A composed installation that runs.

    Attributes
    ----------
    gateway, rest
        As a console calls it; and the same without types.
    """

    composition: Composition
    server: Server
    room: ContainerHands
    gateway: AcknowledgingClient
    rest: RestClient
    acknowledged: Acknowledged

    def hexapod(self) -> Hexapod:
        """The truth about the robot."""
        return Hexapod.model_validate(self.room.control.get("/controller"))

    @contextmanager
    def readiness(self) -> Iterator[ReadinessWatch]:
        """A watch of `readyz`."""
        limits = httpx.Limits(max_keepalive_connections=0)
        with httpx.Client(
            base_url=self.server.url, timeout=_IMPATIENT_S, limits=limits, verify=self.server.trusted()
        ) as http:
            yield ReadinessWatch(http)


@contextmanager
def container_site(composition: Composition) -> Iterator[ContainerSite]:
    """Start an installation and leave nothing behind."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        stack.callback(composition.down)
        composition.up()
        server, token, acknowledged = composition.server(folder), composition.token(), Acknowledged()
        wait_until_usable(server, _READY_WITHIN_S)
        http = stack.enter_context(connection_to(server))
        gateway = AcknowledgingClient(server.url, token, acknowledged, ANSWER_S, http)
        rest = stack.enter_context(RestClient(server.url, token, ANSWER_S, server.trusted()))
        control = stack.enter_context(RestClient(composition.room_url))
        yield ContainerSite(composition, server, ContainerHands(control), gateway, rest, acknowledged)


Injected = Callable[[], AbstractContextManager[None]]
Prepared = Callable[[ContainerSite], Injected]
"""Looks up what the fault needs, so that nothing but the fault lies between the look at the robot and the fault."""


def killed(service: str) -> Prepared:
    """SIGKILL to its first process, with which all of them end; docker starts it again at once."""

    def prepare(site: ContainerSite) -> Injected:
        pid = site.composition.pid(service)

        @contextmanager
        def inject() -> Iterator[None]:
            os.kill(pid, signal.SIGKILL)
            yield

        return inject

    return prepare


def paused(service: str, for_s: float) -> Prepared:
    """All its processes frozen for some time."""

    def prepare(site: ContainerSite) -> Injected:
        place = f"/containers/{site.composition.container(service)}"
        return lambda: _lasting(for_s, partial(_ask_docker, f"{place}/pause"), partial(_ask_docker, f"{place}/unpause"))

    return prepare


def cut_off(service: str, for_s: float) -> Prepared:
    """Its connection to the network of the bus taken away for some time."""

    def prepare(site: ContainerSite) -> Injected:
        container, place = site.composition.container(service), f"/networks/{site.composition.network()}"
        gone = {"Container": container, "Force": True}
        back = {"Container": container, "EndpointConfig": {"Aliases": [service]}}
        return lambda: _lasting(
            for_s, partial(_ask_docker, f"{place}/disconnect", gone), partial(_ask_docker, f"{place}/connect", back)
        )

    return prepare


@contextmanager
def _lasting(for_s: float, begin: Callable[[], None], end: Callable[[], None]) -> Iterator[None]:
    begin()
    began_s = time.monotonic()
    try:
        yield
        time.sleep(max(began_s + for_s - time.monotonic(), 0.0))
    finally:
        end()


def _ask_docker(path: str, content: Mapping[str, object] | None = None) -> None:
    """Ask docker itself: its command takes longer to start than a motion may go on."""
    with httpx.Client(transport=httpx.HTTPTransport(uds=_DOCKER), timeout=_DOCKER_ANSWERS_WITHIN_S) as http:
        http.post(f"http://docker{path}", json=content).raise_for_status()
