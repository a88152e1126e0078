"""A small GCS 2.0 controller at the end of a port, written from the interface's text; motion ends when told to."""

import threading
from collections.abc import Callable, Iterable, Mapping

from shared.geometry.hexapod import AXES

READ_WAIT_S = 0.01
PIVOT = ("R", "S", "T")


class FakeGcs:
    """Answers as a controller would. Tests change its attributes, and spoil its answers with `spoil`."""

    def __init__(self) -> None:
        self._ready = threading.Condition()
        self._output = bytearray()
        self._input = bytearray()
        self.messages: list[bytes] = []
        self.writes: list[bytes] = []
        self.identity = "(c)Fake Instruments, H-70, 0001, 1.0"
        self.axes: tuple[str, ...] = AXES
        self.syntax = "2.0"
        self.position = dict.fromkeys(AXES, 0.0)
        self.target = dict.fromkeys(AXES, 0.0)
        self.servo = dict.fromkeys(AXES, 0)
        self.brake = dict.fromkeys(AXES, 1)
        self.referenced = dict.fromkeys(AXES, 0)
        self.pivot = dict.fromkeys(PIVOT, 0.0)
        self.speed = 1.0
        self.error = 0
        self.moving = False
        self.mute = False
        self.broken: OSError | None = None
        self.brakes_hold = True
        self.reachable = True
        self.pressed = False
        self.closed = False
        self.spoil: Callable[[bytes, bytes], bytes] = lambda _question, answer: answer
        self.disturb: Callable[[bytes], bytes] = lambda message: message

    def read(self, size: int = 1, /) -> bytes:
        """What pyserial's `read` does, with a short time-out."""
        with self._ready:
            self._ready.wait_for(lambda: self._output or self.broken or self.closed, READ_WAIT_S)
            if self.broken:
                raise self.broken
            received = bytes(self._output[:size])
            del self._output[:size]
            return received

    def write(self, data: bytes, /) -> int:
        """What pyserial's `write` does; the controller acts at once."""
        with self._ready:
            if self.broken:
                raise self.broken
            self.writes.append(data)
            for byte in data:
                self._take(byte)
            self._ready.notify_all()
        return len(data)

    def close(self) -> None:
        """End."""
        self.closed = True

    def arrive(self) -> None:
        """The platform reaches its target."""
        with self._ready:
            self.position = dict(self.target)
            self.moving = False

    def say(self, unasked: bytes) -> None:
        """Send something that nobody asked for."""
        with self._ready:
            self._output += unasked
            self._ready.notify_all()

    @property
    def locked(self) -> bool:
        """Brakes on and servos off."""
        return all(self.brake.values()) and not any(self.servo.values())

    def _take(self, byte: int) -> None:
        if byte == 0x18:
            self.messages.append(b"\x18")
            self._stop()
        elif byte == 0x05:
            self._answer(b"\x05", [f"{0x3F if self.moving else 0:X}"])
        elif byte == ord("\n"):
            message = self.disturb(bytes(self._input))
            self._input.clear()
            self.messages.append(message)
            self._obey(message.decode("ascii", errors="replace").split())
        else:
            self._input.append(byte)

    def _stop(self) -> None:
        self.moving = False
        self.target = dict(self.position)
        self.error = 10

    def _obey(self, words: list[str]) -> None:
        if not words:
            return
        name, arguments = words[0], words[1:]
        if name.endswith("?"):
            self._inquire(name, arguments)
        else:
            self._command(name, arguments)

    def _inquire(self, name: str, arguments: list[str]) -> None:
        by_axis: dict[str, Mapping[str, float]] = {
            "POS?": self.position,
            "MOV?": self.target,
            "SVO?": self.servo,
            "BRA?": self.brake,
            "FRF?": self.referenced,
            "SPI?": self.pivot,
            "ONT?": dict.fromkeys(AXES, int(self.position == self.target and not self.moving)),
        }
        bare = {
            "*IDN?": [self.identity],
            "CSV?": [self.syntax],
            "SAI?": list(self.axes),
            "VLS?": [f"{self.speed:.6f}"],
            "VMO?": ["1" if self.reachable else "0"],
        }
        if name == "ERR?":
            self._answer(b"ERR?", [str(self.error)])
            self.error = 0
        elif name in by_axis:
            values = by_axis[name]
            self._answer(name.encode(), [f"{axis}={values[axis]:g}" for axis in arguments])
        elif name in bare:
            self._answer(name.encode(), bare[name])
        else:
            self.error = 2

    def _command(self, name: str, arguments: list[str]) -> None:
        if name == "FRF":
            self.referenced |= dict.fromkeys(arguments, 1)
            return
        values = _pairs(arguments)
        match name:
            case "SVO" if self.pressed and any(values.values()):
                self.error = 500
            case "SVO":
                self.servo |= {axis: int(value) for axis, value in values.items()}
            case "BRA":
                if self.brakes_hold:
                    self.brake |= {axis: int(value) for axis, value in values.items()}
            case "VLS":
                self.speed = float(arguments[0])
            case "SPI":
                self.pivot |= values
            case "MOV" if all(self.servo.values()) and all(self.referenced.values()):
                self.target |= values
                self.moving = True
            case "MOV":
                self.error = 5
            case _:
                self.error = 2

    def _answer(self, question: bytes, lines: Iterable[str]) -> None:
        if not self.mute:
            self._output += self.spoil(question, (" \n".join(lines) + "\n").encode())


def _pairs(arguments: list[str]) -> dict[str, float]:
    return {axis: float(value) for axis, value in zip(arguments[::2], arguments[1::2], strict=False)}
