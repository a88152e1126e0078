"""A composed installation as a procedure and a fault take hold of it."""

import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
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


Injected = Callable[[ContainerSite], AbstractContextManager[None]]


def killed(service: str) -> Injected:
    """SIGKILL to its first process, with which all of them end; docker starts it again at once."""

    @contextmanager
    def inject(site: ContainerSite) -> Iterator[None]:
        os.kill(site.composition.pid(service), signal.SIGKILL)
        yield

    return inject


def paused(service: str, for_s: float) -> Injected:
    """All its processes frozen for some time."""

    @contextmanager
    def inject(site: ContainerSite) -> Iterator[None]:
        container = site.composition.container(service)
        site.composition.docker("pause", container)
        began_s = time.monotonic()
        try:
            yield
            time.sleep(max(began_s + for_s - time.monotonic(), 0.0))
        finally:
            site.composition.docker("unpause", container)

    return inject


def cut_off(service: str, for_s: float) -> Injected:
    """Its connection to the network of the bus taken away for some time."""

    @contextmanager
    def inject(site: ContainerSite) -> Iterator[None]:
        container, network = site.composition.container(service), site.composition.network()
        site.composition.docker("network", "disconnect", "--force", network, container)
        began_s = time.monotonic()
        try:
            yield
            time.sleep(max(began_s + for_s - time.monotonic(), 0.0))
        finally:
            site.composition.docker("network", "connect", "--alias", service, network, container)

    return inject
