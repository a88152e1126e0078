"""A virtual controller behind every kind of line that our driver is meant for."""

import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from services.robot.devices.gcs.controller import GcsController
from services.robot.devices.serial_port import open_port
from simulation.controller.servers import tcp_server, terminal_server
from simulation.controller.virtual_controller import VirtualController
from tests.contract.controller.lines import HEXAPOD, wait_until
from tests.contract.controller.rfc2217_server import rfc2217_server


@pytest.fixture
def virtual() -> VirtualController:
    return VirtualController(HEXAPOD, time.monotonic)


@pytest.fixture(params=["tcp", "pty", "rfc2217"])
def url(request: pytest.FixtureRequest, virtual: VirtualController) -> Iterator[str]:
    with ExitStack() as stack:
        match request.param:
            case "tcp":
                yield f"socket://127.0.0.1:{stack.enter_context(tcp_server(virtual))}"
            case "pty":
                yield stack.enter_context(terminal_server(virtual))
            case _:
                port = stack.enter_context(tcp_server(virtual))
                yield f"rfc2217://127.0.0.1:{stack.enter_context(rfc2217_server(port))}"


@pytest.fixture
def controller(url: str) -> Iterator[GcsController]:
    connected = GcsController(open_port(url, 115200), HEXAPOD)
    yield connected
    connected.close()


@pytest.fixture
def referenced(controller: GcsController) -> GcsController:
    controller.release_stop()
    controller.reference()
    wait_until(lambda: controller.read().referenced)
    return controller
