"""Composition of the virtual operating room: controller, C-arm and control API in one process."""

import contextlib
import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import uvicorn
from fastapi import FastAPI

from shared.errors import ConfigurationError, InputError
from shared.signals import set_by_signals
from shared.threads import described, faults_go_to, supervised_thread
from simulation.control.api import control_app
from simulation.controller.accuracy import seeded
from simulation.controller.servers import tcp_server, terminal_server
from simulation.controller.virtual_controller import VirtualController
from simulation.render.image import render_scene
from simulation.room.foot_pedal import FootPedal
from simulation.room.operating_room import OperatingRoom
from simulation.scenario.bones import BoneKind
from simulation.scenario.files import read_scenario_file, scenario_file_of_seed
from simulation.scenario.sampling import scenario_from_file
from simulation.scenario.values import Scenario
from simulation.settings import VirtualRoomSettings
from simulation.world.poses import starting_state

_DEFAULT_SEED = 0
_WARM_UP_PX = 64
_START_WITHIN_S = 30.0
_END_WITHIN_S = 10.0
# The robot service ends first, and locks the hexapod.
_LINGER_S = 5.0


@dataclass(frozen=True, slots=True)
class Addresses:
    """Where a running virtual operating room can be reached."""

    gcs_port: int
    gcs_terminal: str
    control_url: str


def run_virtual_or(settings: VirtualRoomSettings) -> int:
    """Run until SIGTERM or SIGINT. Call from the main thread.

    Returns
    -------
    int
        Exit code: 0 after a clean end, 1 after a fault, 2 when it cannot start (one line on stderr says why).
    """
    ending = _Ending()
    try:
        scenario = chosen_scenario(settings)
        with (
            faults_go_to(ending),
            set_by_signals(ending.asked, _LINGER_S),
            virtual_room(settings, scenario) as addresses,
        ):
            _announce(scenario, settings, addresses)
            ending.asked.wait()
    except (ConfigurationError, InputError) as error:
        print(f"virtual-or: {error}", file=sys.stderr)  # noqa: T201 - the one sentence for the person at the terminal
        return 2
    if ending.fault is not None:
        print(f"virtual-or: fault: {ending.fault}", file=sys.stderr)  # noqa: T201 - likewise
        return 1
    return 0


class _Ending:
    """When the room is to end, and whether by a fault."""

    def __init__(self) -> None:
        self.asked = threading.Event()
        self.fault: str | None = None

    def fail(self, message: str) -> None:
        """See `FaultListener`."""
        self.fault = self.fault or message
        self.asked.set()

    def note_error(self, place: str, error: BaseException) -> None:
        """See `FaultListener`: a room that stands for hardware must not go on with a part missing."""
        self.fail(f"{place} brought {described(error)}")


def chosen_scenario(settings: VirtualRoomSettings) -> Scenario:
    """The scenario that the settings name; raises `ScenarioInvalid`."""
    if settings.scenario is not None:
        return scenario_from_file(read_scenario_file(settings.scenario), settings.scenario.parent)
    seed = _DEFAULT_SEED if settings.seed is None else settings.seed
    return scenario_from_file(scenario_file_of_seed(seed, settings.bone or BoneKind.FEMUR), Path())


@contextlib.contextmanager
def virtual_room(settings: VirtualRoomSettings, scenario: Scenario) -> Iterator[Addresses]:
    """Run controller and control API for as long as the context lasts; both answer when it is entered.

    Raises
    ------
    ConfigurationError
        When a port is in use.
    """
    controller = VirtualController(scenario.parts.hexapod, time.monotonic, seeded(scenario.seed))
    room = OperatingRoom(scenario, lambda: controller.snapshot().base_from_top)
    app = control_app(room, FootPedal(room, settings.target), controller)
    with (
        contextlib.closing(_listener(settings.host, settings.control_port)) as listener,
        tcp_server(controller, settings.host, settings.gcs_port, settings.gcs_baud) as gcs_port,
        terminal_server(controller, settings.gcs_baud) as terminal,
    ):
        _warm_up(scenario)
        with _served(app, listener):
            host, port = listener.getsockname()[:2]
            yield Addresses(gcs_port, terminal, f"http://{host}:{port}")


def _listener(host: str, port: int) -> socket.socket:
    try:
        listener = socket.create_server((host, port))
    except OSError as error:
        raise ConfigurationError(
            f"the control API cannot listen at {host}:{port}: {os.strerror(error.errno or 0)}; "
            "stop the program that uses the port, or choose another with --control-port"
        ) from None
    # Or each answer's body would wait for the client's delayed acknowledgement of its head; connections inherit it.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def _warm_up(scenario: Scenario) -> None:
    """Compile the ray tracer now, not during the first shot."""
    small = replace(scenario, c_arm=replace(scenario.c_arm, size_px=_WARM_UP_PX))
    render_scene(small, starting_state(small))


@contextlib.contextmanager
def _served(app: FastAPI, listener: socket.socket) -> Iterator[None]:
    """Serve on a thread of its own, so that signals stay with the main thread."""
    server = uvicorn.Server(uvicorn.Config(app, log_level="warning", access_log=False, lifespan="off"))
    serving = supervised_thread("control api", lambda: server.run([listener]))
    serving.start()
    deadline = time.monotonic() + _START_WITHIN_S
    while not server.started:
        if not serving.is_alive() or time.monotonic() > deadline:
            raise ConfigurationError(f"the control API did not start within {_START_WITHIN_S:g} s; see the log above")
        serving.join(0.01)
    try:
        yield
    finally:
        server.should_exit = True
        serving.join(_END_WITHIN_S)


def _announce(scenario: Scenario, settings: VirtualRoomSettings, addresses: Addresses) -> None:
    target = f"to {settings.target}" if settings.target else "nowhere (no --dicom-target)"
    print(  # noqa: T201 - where to reach it, for the person at the terminal
        f"virtual operating room, seed {scenario.seed}: hexapod controller at {settings.host}:{addresses.gcs_port} and "
        f"{addresses.gcs_terminal}, control at {addresses.control_url}, images go {target}",
        flush=True,
    )
