"""A whole installation of real processes with the virtual operating room, for tests that speak REST only."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from distalock.case_client import CaseClient
from distalock.installation import Installation, Ports
from distalock.processes import Fleet
from distalock.rest_client import RestClient
from distalock.room_client import RoomClient

SEED = 2


@dataclass(frozen=True, slots=True)
class OperatingRoom:
    """A running installation, as a console and a person in the room see it."""

    fleet: Fleet
    installation: Installation
    rest: RestClient
    control: RestClient

    @property
    def room(self) -> RoomClient:
        return RoomClient(self.control)

    def open_case(self) -> CaseClient:
        return CaseClient(self.rest, self.room.scenario().set_up)


def patient_fleet(installation: Installation) -> Fleet:
    """The installation's processes, with time to start on a machine that is busy otherwise."""
    return installation.fleet(threading.Event(), start_patience_s=300.0)


@contextmanager
def operating_room(folder: Path, seed: int) -> Iterator[OperatingRoom]:
    """Start everything, and leave nothing behind."""
    installation = Installation(Ports.any_free(), folder, scenario_arguments=("--seed", str(seed)))
    with (
        patient_fleet(installation) as fleet,
        RestClient(installation.ports.rest_url) as rest,
        RestClient(installation.ports.control_url) as control,
    ):
        yield OperatingRoom(fleet, installation, rest, control)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OperatingRoom]:
    """A fresh installation for a file's tests."""
    print(f"scenario seed {SEED}")
    with operating_room(tmp_path_factory.mktemp("room"), SEED) as room:
        yield room
