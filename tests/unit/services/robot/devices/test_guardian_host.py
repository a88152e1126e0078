"""Guardians in another container: the line is handed over, and outlives the service that was killed."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from services.robot.devices import guardian_host
from services.robot.devices.guardian import Guardian, GuardianLost, hosted_at

STOP, LOCK = b"stop!", b"lock!"
ROUND = STOP + LOCK
Host = tuple[Path, "subprocess.Popen[bytes]"]
Line = tuple[socket.socket, socket.socket]
PATIENCE_S = 60.0


@pytest.fixture
def host(tmp_path: Path) -> Iterator[Host]:
    path = tmp_path / "socket"
    process = subprocess.Popen([sys.executable, "-I", "-S", guardian_host.__file__, str(path)])
    deadline_s = time.monotonic() + PATIENCE_S
    while not path.exists():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
    yield path, process
    with suppress(ProcessLookupError):
        process.kill()
    process.wait()


@pytest.fixture
def line() -> Iterator[Line]:
    near, far = socket.socketpair()
    with near, far:
        yield near, far


def armed(path: Path, near: socket.socket) -> Guardian:
    guardian = Guardian(hosted_at(path))
    guardian.watch(near.fileno(), STOP, LOCK)
    guardian.wait_until_ready()
    guardian.arm()
    return guardian


def _keep_alive_until(guardian: Guardian, deadline_s: float) -> None:
    while time.monotonic() < deadline_s:
        guardian.keep_alive()
        time.sleep(0.01)


def read(line: socket.socket, count: int) -> bytes:
    line.settimeout(PATIENCE_S)
    content = b""
    while len(content) < count:
        content += line.recv(count - len(content))
    return content


def test_a_service_that_is_killed_with_its_whole_container_leaves_the_robot_stopped(
    host: Host,
    line: Line,
) -> None:
    near, far = line
    service = os.fork()
    if service == 0:
        armed(host[0], near)
        os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(service, 0)
    near.close()
    assert read(far, 2 * len(ROUND)) == 2 * ROUND


def test_one_that_leaves_a_locked_robot_writes_nothing(host: Host, line: Line) -> None:
    near, far = line
    guardian = armed(host[0], near)
    guardian.disarm()
    guardian.leave()
    near.close()
    far.settimeout(PATIENCE_S)
    assert far.recv(1) == b""  # the guardian has closed the line, too


def test_a_host_that_is_killed_in_motion_is_a_loss_and_another_one_is_found_again(
    host: Host,
    line: Line,
) -> None:
    path, process = host
    near, _ = line
    guardian = armed(path, near)
    assert guardian._process is not None
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    process.kill()
    for child in children:  # a container's other processes end with the first
        os.kill(int(child), signal.SIGKILL)
    process.wait()
    deadline_s = time.monotonic() + PATIENCE_S
    with pytest.raises(GuardianLost):
        _keep_alive_until(guardian, deadline_s)
    path.unlink()
    again = subprocess.Popen([sys.executable, "-I", "-S", guardian_host.__file__, str(path)])
    try:
        while guardian.lost():
            assert time.monotonic() < deadline_s, guardian.lost()
            guardian.keep_alive()
            time.sleep(0.05)
    finally:
        guardian.leave()
        again.terminate()
        assert again.wait(PATIENCE_S) == 0


def test_without_a_host_nothing_moves_and_the_reason_is_said(tmp_path: Path, line: Line) -> None:
    near, _ = line
    guardian = Guardian(hosted_at(tmp_path / "nobody"))
    guardian.watch(near.fileno(), STOP, LOCK)
    assert "cannot be started" in guardian.lost()
    with pytest.raises(GuardianLost, match="cannot be started"):
        guardian.arm()


def test_a_host_ends_when_it_is_told_to_and_a_health_check_does_not_disturb_it(
    host: Host,
    line: Line,
) -> None:
    path, process = host
    with socket.socket(socket.AF_UNIX) as probe:
        probe.connect(str(path))
    assert (path.stat().st_mode & 0o777) == 0o600
    near, _ = line
    armed(path, near).leave()
    process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE_S) == 0
