"""The guardian process at the end of a line that the test reads: when it stops the robot, and when it must not."""

import os
import select
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

import pytest

from services.robot.core.tuning import GUARDING
from services.robot.devices.controller import StopInForce
from services.robot.devices.guardian import ChildGuardian, Guardian, GuardianLost, file_number_of
from services.robot.devices.guardian_process import ARM, ROUNDS
from services.robot.devices.serial_port import open_port

STOP, LOCK = b"\x18", b"lock\n"
PATIENCE_S = 60.0
QUIET_S = 0.2


class Line:
    """A line with the guardian at its near end."""

    def __init__(self) -> None:
        self.near, self.far = socket.socketpair()
        self.far.settimeout(PATIENCE_S)
        self.guardian = Guardian()
        self.guardian.watch(self.near.fileno(), STOP, LOCK)
        self.guardian.wait_until_ready()
        assert self.guardian.lost() == ""

    @property
    def pid(self) -> int:
        process = self.guardian._process
        assert process is not None
        assert isinstance(process, ChildGuardian)
        return process.process.pid

    def wait(self, condition: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline_s, f"not in time; {self.guardian.lost()}"
            self.guardian.keep_alive()
            time.sleep(0.01)

    def written(self, count: int) -> bytes:
        content = b""
        while len(content) < count:
            content += self.far.recv(count - len(content))
        return content

    def is_quiet(self) -> bool:
        return not select.select([self.far], [], [], QUIET_S)[0]


@pytest.fixture
def line() -> Iterator[Line]:
    made = Line()
    yield made
    made.guardian.leave()
    made.near.close()
    made.far.close()


def test_a_service_that_has_gone_while_armed_is_followed_by_stop_and_lock(line: Line) -> None:
    line.guardian.arm()
    assert line.guardian._socket is not None
    line.guardian._socket.close()  # as the end of the process does
    assert line.written(ROUNDS * len(STOP + LOCK)) == ROUNDS * (STOP + LOCK)
    os.waitpid(line.pid, 0)
    assert line.is_quiet(), "it leaves the line to the next service"


def test_a_service_that_is_silent_while_armed_is_stopped_once_and_learns_of_it(line: Line) -> None:
    line.guardian.arm()
    assert line.written(ROUNDS * len(STOP + LOCK)) == ROUNDS * (STOP + LOCK)
    with pytest.raises(StopInForce, match=r"guardian process has stopped the robot, because .* more than 0\.2 s"):
        line.wait(lambda: False)
    assert line.is_quiet()
    line.guardian.arm()
    line.guardian.disarm()
    assert line.is_quiet()


def test_a_motion_does_not_begin_when_the_guardian_has_stopped_the_robot_meanwhile(
    line: Line, monkeypatch: pytest.MonkeyPatch
) -> None:
    send = line.guardian._send

    def send_and_stand_still(message: bytes) -> None:
        send(message)
        if message == ARM:
            assert line.written(ROUNDS * len(STOP + LOCK)) == ROUNDS * (STOP + LOCK)
            time.sleep(QUIET_S)  # its answer follows what it wrote

    monkeypatch.setattr(line.guardian, "_send", send_and_stand_still)
    with pytest.raises(StopInForce, match=r"has stopped the robot before its motion began, because .* 0\.2 s"):
        line.guardian.arm()
    monkeypatch.undo()
    line.guardian.arm()
    assert line.written(ROUNDS * len(STOP + LOCK)) == ROUNDS * (STOP + LOCK), "armed again, it watches again"


def test_signs_of_life_keep_it_quiet(line: Line) -> None:
    line.guardian.arm()
    deadline_s = time.monotonic() + 3.0 * GUARDING.silence_s
    line.wait(lambda: time.monotonic() > deadline_s)
    line.guardian.disarm()
    assert line.is_quiet()


def test_a_service_that_has_gone_at_rest_leaves_nothing_behind(line: Line) -> None:
    line.guardian.arm()
    line.guardian.disarm()
    pid = line.pid
    line.guardian.leave()
    assert line.is_quiet()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert "no controller is connected" in line.guardian.lost()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_what_ends_the_services_group_does_not_end_it(line: Line, number: signal.Signals) -> None:
    assert os.getsid(line.pid) == line.pid
    os.kill(line.pid, number)
    line.guardian.arm()
    line.guardian.disarm()


def test_one_that_is_killed_in_motion_is_reported_once_and_started_again_at_rest(line: Line) -> None:
    line.guardian.arm()
    os.kill(line.pid, signal.SIGKILL)
    with pytest.raises(GuardianLost, match="the guardian process has ended"):
        line.wait(lambda: False)
    with pytest.raises(GuardianLost):
        line.guardian.arm()
    line.wait(lambda: line.guardian.lost() == "")
    line.guardian.arm()
    line.guardian.disarm()


def test_one_that_hangs_in_motion_is_reported_and_replaced(line: Line) -> None:
    line.guardian.arm()
    hung = line.pid
    os.kill(hung, signal.SIGSTOP)
    with pytest.raises(GuardianLost, match=r"not answered for 0\.\d+ s \(limit 0\.3 s\)|has not answered for"):
        line.wait(lambda: False)
    line.wait(lambda: line.guardian.lost() == "")
    assert line.pid != hung
    with pytest.raises(ProcessLookupError):
        os.kill(hung, 0)


def test_one_that_hangs_at_rest_lets_nothing_be_armed(line: Line) -> None:
    os.kill(line.pid, signal.SIGSTOP)
    with pytest.raises(GuardianLost, match="did not confirm that it is armed"):
        line.guardian.arm()


def test_one_that_cannot_be_started_is_a_reason_and_no_error() -> None:
    guardian = Guardian()
    guardian.watch(None, STOP, LOCK)
    assert guardian.lost() == "this kind of line cannot be shared with a guardian process"
    for refused in (guardian.wait_until_ready, guardian.arm):
        with pytest.raises(GuardianLost, match="cannot be shared"):
            refused()


def test_a_line_that_takes_nothing_is_tried_again_until_it_does(line: Line) -> None:
    line.near.setblocking(False)
    with suppress(BlockingIOError):
        while True:
            line.near.send(bytes(4096))
    line.guardian.arm()
    time.sleep(2.0 * GUARDING.silence_s)
    received = bytearray()
    while not received.endswith(ROUNDS * (STOP + LOCK)):
        received += line.far.recv(65536)


def test_a_file_number_of_every_kind_of_port() -> None:
    listener = socket.create_server(("127.0.0.1", 0))
    port = open_port(f"socket://127.0.0.1:{listener.getsockname()[1]}", 115200)
    assert isinstance(file_number_of(port), int)
    port.close()
    listener.close()
    assert file_number_of(object()) is None
