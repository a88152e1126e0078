"""A second dialect: the port, the serial line and the drive suffice for a protocol that has nothing of GCS."""

from services.robot.core.controller_feedback import ControllerError, ControllerFeedback, ErrorKind
from services.robot.devices.controller import Encoders, StopInForce, garbled, number_in
from services.robot.devices.dialects import DIALECTS, Dialect, Driver
from services.robot.devices.guardian import LineGuardian
from services.robot.devices.serial_line import LineProtocol, SerialLine
from services.robot.devices.serial_port import Port
from shared.errors import DeviceError
from shared.geometry.hexapod import HexapodPart, PlatformPose
from shared.parts.hexapod_file import default_hexapod
from tests.unit.services.robot.text_device import TextDevice, drive_through

HEXAPOD = default_hexapod()
LINE = LineProtocol(b"!", b"lock\n", b"hello\n", ("here",), another_line_follows=lambda line: line.endswith("&"))


class ToyController:
    """The driver of a dialect with one question, without what `docs/robot.md` asks of one that moves a real robot."""

    def __init__(
        self, port: Port, hexapod: HexapodPart, encoders: Encoders, reply_timeout_s: float, guardian: LineGuardian
    ) -> None:
        assert (hexapod, encoders) == (HEXAPOD, Encoders.ABSOLUTE)
        self._line = SerialLine(port, LINE, reply_timeout_s, guardian)
        self._line.stop_now()
        self._line.wait_for_guardian()

    @property
    def identity(self) -> str:
        return "toy"

    def read(self) -> ControllerFeedback:
        return self._line.ask(b"state\n", _feedback)

    def reference(self) -> None:
        self._line.write_unless_stopped(b"reference\n")

    def move(self, target: PlatformPose, speed_mm_per_s: float) -> None:
        assert speed_mm_per_s > 0.0
        self._line.write_unless_stopped(f"go {' '.join(f'{v:.6f}' for v in target.as_array())}\n".encode())
        error = self.read().error
        if error is not None and error.is_stop:
            raise StopInForce(error.message)

    def lock(self) -> None:
        self._line.write(b"lock\n")
        if self.read().locked:
            self._line.note_locked()

    def stop_now(self) -> DeviceError | None:
        return self._line.stop_now()

    def release_stop(self) -> None:
        self._line.release_stop()

    def close(self) -> None:
        self._line.close()


def _feedback(lines: list[str]) -> ControllerFeedback:
    if len(lines) != 2 or len(lines[0].split()) != 7:
        raise garbled("state", lines)
    *pose, end = lines[0].split()
    flags = lines[1]
    pressed = ControllerError(ErrorKind.STOP_BUTTON_PRESSED, "the red button is pressed; release it")
    assert end == "&"
    return ControllerFeedback(
        pose=PlatformPose(*(number_in(value, "state", lines) for value in pose)),
        moving="M" in flags,
        on_target="M" not in flags,
        locked="L" in flags,
        unlocked="L" not in flags,
        referenced="R" in flags,
        error=pressed if "B" in flags else None,
    )


class ToyDevice(TextDevice):
    """Three flags (locked, moving, referenced), a button, and a pose."""

    def __init__(self) -> None:
        super().__init__()
        self.pose, self.target = [0.0] * 6, [0.0] * 6
        self.locked, self.moving, self.referenced, self.button = False, True, False, False

    def obey(self, message: bytes) -> bytes:
        match message.decode().split():
            case ["!"]:
                self.moving, self.locked = False, True
            case ["hello"]:
                return b"here\n"
            case ["state"]:
                flags = f"L{self.locked:d}M{self.moving:d}R{self.referenced:d}B{self.button:d}"
                shown = "".join(flags[i] for i in range(0, 8, 2) if flags[i + 1] == "1") or "-"
                return f"{' '.join(map(str, self.pose))} &\n{shown}\n".encode()
            case ["go", *values]:
                self.target, self.moving, self.locked = [float(v) for v in values], True, False
            case ["reference"]:
                self.referenced = True
            case ["lock"]:
                self.locked = True
        return b""

    def arrive(self) -> None:
        self.pose, self.moving = self.target, False


def test_the_drive_references_moves_and_stops_a_robot_that_speaks_another_dialect() -> None:
    driver: Driver = ToyController
    pressed = drive_through(driver, ToyDevice(), HEXAPOD)
    assert pressed.detail == "not by this service: the red button is pressed; release it"


def test_every_dialect_has_a_driver_and_asks_who_is_there() -> None:
    assert set(DIALECTS) == set(Dialect)
