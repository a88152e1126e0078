"""What several of the robot's tests stand on."""

from collections.abc import Iterator

import pytest

from services.robot.devices.gcs.controller import GcsController
from tests.unit.services.robot.drive_bench import Bench
from tests.unit.services.robot.fake_gcs import FakeGcs
from tests.unit.services.robot.room import HEXAPOD, Room


@pytest.fixture
def room() -> Iterator[Room]:
    made = Room()
    with made.service:
        yield made


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    assert made.crashes == []


@pytest.fixture
def gcs() -> FakeGcs:
    return FakeGcs()


@pytest.fixture
def controller(gcs: FakeGcs) -> Iterator[GcsController]:
    gcs.referenced = dict.fromkeys(gcs.referenced, 1)
    connected = GcsController(gcs, HEXAPOD)
    yield connected
    connected.close()


@pytest.fixture
def released(controller: GcsController) -> GcsController:
    controller.release_stop()
    return controller
