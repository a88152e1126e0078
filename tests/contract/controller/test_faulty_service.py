"""The robot service in motion, with an exception in each of its loops: at rest, locked, ended with an error."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import NoReturn

import pytest

from services.robot.__main__ import compose
from services.robot.devices.gcs.controller import GcsController
from services.robot.service import RobotService
from services.robot.settings import RobotSettings
from shared.bus.keys import Keys
from shared.bus.memory_bus import MemoryRouter
from shared.bus.port import Bus
from shared.bus.tls import PKI_FOLDER
from shared.pki.keystore import Keystore
from shared.runtime.lifecycle import Runtime, run_service
from shared.runtime.presence import beating
from simulation.controller.servers import tcp_server
from simulation.controller.virtual_controller import VirtualController
from tests.contract.controller.lines import FAR, HEXAPOD, wait_until
from tests.contract.controller.test_drive_on_virtual_controller import begin, make_ready

AT_REST_WITHIN_S = 0.5
KEYS = Keys("or1")


class Injected(Exception):
    """What no loop is prepared for."""


def inject(*_: object) -> NoReturn:
    raise Injected("injected")


class Broken:
    """Whatever a loop asks."""

    link_up = put = close = inject


def line_of(service: RobotService) -> GcsController:
    controller = service._drive._motion.controller
    assert isinstance(controller, GcsController)
    return controller


def break_worker(service: RobotService) -> None:
    line_of(service).read = inject  # type: ignore[method-assign]


def break_reader(service: RobotService) -> None:
    line_of(service)._line._port.read = inject  # type: ignore[method-assign]


def break_state(service: RobotService) -> None:
    service._publisher = Broken()


def break_watch(service: RobotService) -> None:
    service.watch._presence = Broken()  # type: ignore[assignment]


def break_handler(service: RobotService) -> None:
    service._registration._on_epoch = inject  # type: ignore[method-assign, assignment]
    service.listen()
    service._bus.publisher(KEYS.registration_epoch).put(b"")


@pytest.mark.requirement("ROB-16")
@pytest.mark.parametrize("broken", [break_worker, break_reader, break_state, break_watch, break_handler])
def test_an_exception_in_motion_stops_locks_and_ends_the_service_with_an_error(
    broken: Callable[[RobotService], None], capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    controller = VirtualController(HEXAPOD, time.monotonic)
    router = MemoryRouter()
    took_s: list[float] = []

    @contextmanager
    def in_motion(settings: RobotSettings, bus: Bus, runtime: Runtime) -> Iterator[None]:
        with beating(router.open(), KEYS, "ui_api", "gateway-1", 20.0), compose(settings, bus, runtime) as service:
            wait_until(lambda: service.watch.heartbeat_s() is not None)
            make_ready(service._drive)
            begin(service._drive, FAR, 10.0)
            wait_until(lambda: controller.snapshot().moving)
            began_s = time.monotonic()
            broken(service)
            wait_until(lambda: not controller.snapshot().moving)
            took_s.append(time.monotonic() - began_s)
            yield

    with tcp_server(controller) as port:
        Keystore(tmp_path / PKI_FOLDER).ensure(datetime.now(UTC))
        url = f"socket://127.0.0.1:{port}"
        settings = RobotSettings(controller_url=url, heartbeat_deadline_s=0.5, state_dir=tmp_path)
        code = run_service(
            "robot", settings, lambda bus, runtime: in_motion(settings, bus, runtime), lambda _: router.open()
        )
    assert code == 1
    assert "Injected: injected" in capfd.readouterr().err.splitlines()[-1]
    assert took_s[0] < AT_REST_WITHIN_S
    assert controller.snapshot().brake_on
    assert not controller.snapshot().servo_on
    assert not controller.snapshot().was_unheld
