"""A port with a device at its end that is told text and answers with text: for the tests of a small dialect."""

import queue
from abc import ABC, abstractmethod
from typing import Protocol

from services.robot.core.guard import PermittedMove
from services.robot.core.status import DriveStatus
from services.robot.core.tuning import SUPERVISION
from services.robot.devices.controller import Encoders, HexapodController
from services.robot.devices.dialects import Driver
from services.robot.devices.guardian import UNGUARDED
from services.robot.devices.serial_port import Port
from services.robot.drive.drive import Drive
from shared.geometry.hexapod import ZERO_POSE, HexapodPart, PlatformPose
from shared.robot_states import MotionState, StopButton

READ_WAIT_S = 0.01
TARGET = PlatformPose(2.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class TextDevice(ABC):
    """What pyserial would be; a test writes `obey`."""

    def __init__(self) -> None:
        self.messages: list[bytes] = []
        self.closed = False
        self._answers: queue.Queue[int] = queue.Queue()

    @abstractmethod
    def obey(self, message: bytes) -> bytes:
        """Do what was written in one go; the answer, or nothing."""

    def write(self, data: bytes, /) -> int:
        """What pyserial's `write` does; the device acts at once."""
        self.messages.append(data)
        for byte in self.obey(data):
            self._answers.put(byte)
        return len(data)

    def read(self, size: int = 1, /) -> bytes:
        """What pyserial's `read` does, with a short time-out."""
        assert size == 1
        try:
            return bytes([self._answers.get(timeout=READ_WAIT_S)])
        except queue.Empty:
            return b""

    def close(self) -> None:
        """End."""
        self.closed = True


class RobotDevice(Port, Protocol):
    """A device with a robot: what it does, and what a test does to it."""

    locked: bool
    moving: bool
    button: bool

    def arrive(self) -> None:
        """Be at the target, at rest."""


def drive_through(driver: Driver, device: RobotDevice, hexapod: HexapodPart) -> DriveStatus:
    """Drive a robot through reference, a move to `TARGET` and its stop button, as the robot service does.

    Returns the status with the button pressed.
    """

    def connect() -> HexapodController:
        return driver(device, hexapod, Encoders.ABSOLUTE, 0.25, UNGUARDED)

    drive = Drive(connect, SUPERVISION.read_back, lambda: 50.0, 1.0, print)

    def work(rounds: int = 3) -> MotionState:
        for _ in range(rounds):
            drive.step()
        return drive.status.state

    assert work() is MotionState.STOPPED
    assert (device.moving, device.locked) == (False, True)
    assert drive.acknowledge_stop() is None
    assert work() is MotionState.UNREFERENCED
    assert drive.begin_reference("r1") is None
    assert work() is MotionState.LOCKED
    assert drive.begin_move("m1", lambda _: PermittedMove("a" * 64, ZERO_POSE, TARGET, 2.0, 1.0)) is None
    assert work(1) is MotionState.MOVING
    device.arrive()
    assert work() is MotionState.LOCKED
    assert drive.status.outcome == "reached"
    device.button = True
    assert work() is MotionState.STOPPED
    pressed = drive.status
    assert pressed.stop_button is StopButton.PRESSED
    drive.leave()
    work()
    return pressed
