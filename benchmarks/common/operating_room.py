"""A whole installation of real processes with the virtual operating room, for whoever speaks REST only."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

from distalock.case_client import CaseClient
from distalock.client import Client
from distalock.installation import Installation
from distalock.processes import Fleet, ProcessSpec
from distalock.rest_client import RestClient
from distalock.room_client import RoomClient

# For who stands for many consoles at once.
WITHOUT_RATE_LIMITS: Final = {
    "DISTALOCK_UI_API_REQUESTS_PER_S": "0",
    "DISTALOCK_UI_API_REQUESTS_PER_ADDRESS_PER_S": "0",
}
# A machine that is busy otherwise starts processes slowly.
START_PATIENCE_S = 300.0


@dataclass(frozen=True, slots=True)
class OperatingRoom:
    """A running installation, as a console and a person in the room see it.

    Attributes
    ----------
    gateway
        As a console calls it.
    rest
        The same without types, for what no console sends.
    """

    fleet: Fleet
    installation: Installation
    gateway: Client
    rest: RestClient
    control: RestClient

    @property
    def room(self) -> RoomClient:
        """What hands do in the room."""
        return RoomClient(self.control)

    def open_case(self) -> CaseClient:
        """Open a case as the scenario sets it up."""
        return CaseClient.opened(self.gateway, self.room.scenario().set_up)


def patient_fleet(installation: Installation, change: Callable[[ProcessSpec], ProcessSpec] = lambda s: s) -> Fleet:
    """The installation's processes, with time to start; `change` may replace what is run."""
    return installation.fleet(threading.Event(), START_PATIENCE_S, change)


@contextmanager
def running(
    installation: Installation, change: Callable[[ProcessSpec], ProcessSpec] = lambda s: s
) -> Iterator[OperatingRoom]:
    """Start everything, and leave nothing behind."""
    with (
        patient_fleet(installation, change) as fleet,
        Client(installation.ports.rest_url, installation.token) as gateway,
        RestClient(installation.ports.rest_url, installation.token) as rest,
        RestClient(installation.ports.control_url) as control,
    ):
        yield OperatingRoom(fleet, installation, gateway, rest, control)
