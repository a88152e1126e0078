"""A robot service that is killed or hangs in motion: its guardian stops and locks the robot, on every kind of line."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest

from services.robot.devices.gcs.controller import GcsController
from services.robot.devices.serial_port import open_port
from shared.errors import DeviceError
from simulation.controller.virtual_controller import VirtualController
from tests.contract.controller.lines import HEXAPOD, wait_until

# The requirement: whatever dies, the robot is at rest and locked within half a second and a millimetre.
LOCKED_WITHIN_S, LOCKED_WITHIN_MM = 0.5, 1.0

# pyserial's RFC 2217 names its thread in a way that Python 3.10 deprecated.
pytestmark = pytest.mark.filterwarnings("ignore:set(Daemon|Name)\\(\\) is deprecated:DeprecationWarning")


@pytest.fixture
def service(url: str) -> Iterator[subprocess.Popen[str]]:
    """A service in motion."""
    command = [sys.executable, "-m", "tests.contract.controller.guarded_drive", url]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line == "moving\n":
                break
        yield process
        process.kill()


def require_locked(virtual: VirtualController, since_s: float, began_mm: np.ndarray) -> None:
    wait_until(lambda: virtual.snapshot().brake_on and not virtual.snapshot().servo_on)
    took_s, truth = time.monotonic() - since_s, virtual.snapshot()
    way_mm = float(np.linalg.norm(truth.pose.as_array()[:3] - began_mm))
    print(f"locked after {1e3 * took_s:.0f} ms and {way_mm:.2f} mm")
    assert not truth.moving
    assert not truth.was_unheld
    assert took_s <= LOCKED_WITHIN_S
    assert way_mm <= LOCKED_WITHIN_MM


@pytest.mark.requirement("ROB-07")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_service_that_is_killed_or_hangs_in_motion_leaves_the_robot_locked(
    service: subprocess.Popen[str], virtual: VirtualController, url: str, number: signal.Signals
) -> None:
    began_mm, since_s = virtual.snapshot().pose.as_array()[:3], time.monotonic()
    os.kill(service.pid, number)
    require_locked(virtual, since_s, began_mm)
    service.kill()
    service.wait()
    connected: list[GcsController] = []

    def next_service_connects() -> bool:
        """As soon as the guardian has left the line, which nobody else may hold at the same time."""
        try:
            connected.append(GcsController(open_port(url, 115200), HEXAPOD))
        except DeviceError:
            return False
        return True

    wait_until(next_service_connects)
    assert connected[0].read().locked
    connected[0].close()


@pytest.mark.parametrize("url", ["pty"], indirect=True)
def test_a_service_that_goes_on_after_it_hung_moves_nothing(
    service: subprocess.Popen[str], virtual: VirtualController
) -> None:
    os.kill(service.pid, signal.SIGSTOP)
    wait_until(lambda: virtual.snapshot().brake_on and not virtual.snapshot().servo_on)
    here = virtual.snapshot().pose
    os.kill(service.pid, signal.SIGCONT)
    time.sleep(0.5)
    truth = virtual.snapshot()
    assert truth.pose == here
    assert (truth.brake_on, truth.servo_on, truth.was_unheld) == (True, False, False)


@pytest.mark.requirement("ROB-07")
@pytest.mark.parametrize("url", ["pty"], indirect=True)
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_guardian_that_is_killed_or_hangs_in_motion_stops_it(
    service: subprocess.Popen[str], virtual: VirtualController, number: signal.Signals
) -> None:
    began_mm, since_s = virtual.snapshot().pose.as_array()[:3], time.monotonic()
    os.kill(guardian_of(service.pid), number)
    require_locked(virtual, since_s, began_mm)


def guardian_of(pid: int) -> int:
    children = subprocess.run(["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True, check=True)
    return int(children.stdout.split()[0])
