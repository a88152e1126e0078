"""The letters of GCS 2.0: bytes to lines and single-byte commands, lines to words, values to replies. Pure."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum

LINE_END = b"\n"
LONGEST_LINE = 1024
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


class SingleByte(IntEnum):
    """Commands of one byte, without a line end, obeyed at once."""

    MOTION_STATUS = 5
    READY = 7
    STOP_ALL = 24


_SINGLE_BYTES = frozenset(int(byte) for byte in SingleByte)


class GcsError(IntEnum):
    """Error codes, silent until `ERR?`; numbers as the protocol's maker gives them."""

    NONE = 0
    SYNTAX = 1
    UNKNOWN_COMMAND = 2
    LINE_TOO_LONG = 3
    NOT_REFERENCED_OR_SERVO_OFF = 5
    OUT_OF_LIMITS = 7
    VELOCITY_OUT_OF_LIMITS = 8
    PIVOT_WHILE_ROTATED = 9
    STOPPED = 10
    UNKNOWN_AXIS = 15
    VALUE_OUT_OF_RANGE = 17
    LIMIT_SWITCH = 216
    EMERGENCY_STOP = 500
    EMERGENCY_STOP_WAS_PRESSED = 501
    MOTION_ERROR = -1024


class GcsRefusal(Exception):
    """A command that cannot be obeyed; becomes the controller's error code."""

    def __init__(self, error: GcsError) -> None:
        super().__init__(error.name)
        self.error = error


@dataclass(frozen=True, slots=True)
class Line:
    """One command line: its mnemonic and words."""

    mnemonic: str
    words: tuple[str, ...]


class Assembler:
    """Bytes as they arrive to whole lines and single-byte commands, in order; the one state a connection has."""

    def __init__(self) -> None:
        self._pending = bytearray()

    def feed(self, received: bytes) -> list[str | SingleByte]:
        """Lines (without their end) and single bytes completed by what was received."""
        complete: list[str | SingleByte] = []
        for byte in received:
            if byte in _SINGLE_BYTES:
                complete.append(SingleByte(byte))
            elif byte == LINE_END[0]:
                complete.append(self._take())
            elif len(self._pending) <= LONGEST_LINE:
                self._pending.append(byte)
        return complete

    def _take(self) -> str:
        # Bytes beyond ASCII map to themselves, so that the parser sees and refuses them.
        line = self._pending.decode("latin-1").rstrip("\r")
        self._pending.clear()
        return line


def parse_line(text: str) -> Line | None:
    """Split a line; None when it is empty.

    Raises
    ------
    GcsRefusal
        When the line is too long or not printable ASCII.
    """
    if len(text) > LONGEST_LINE:
        raise GcsRefusal(GcsError.LINE_TOO_LONG)
    if not text.isascii() or not text.isprintable():
        raise GcsRefusal(GcsError.SYNTAX)
    words = text.split()
    return Line(words[0].upper(), tuple(words[1:])) if words else None


def axes_of(words: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """The named axes, or all when none is named; raises `GcsRefusal`."""
    if any(word not in known for word in words):
        raise GcsRefusal(GcsError.UNKNOWN_AXIS)
    if len(set(words)) < len(words):
        raise GcsRefusal(GcsError.SYNTAX)
    return tuple(words) or tuple(known)


def axis_values(words: Sequence[str], known: Sequence[str]) -> dict[str, float]:
    """Pairs of axis and value, at least one; raises `GcsRefusal`."""
    if not words or len(words) % 2:
        raise GcsRefusal(GcsError.SYNTAX)
    axes = axes_of(words[0::2], known)
    return {axis: number(word) for axis, word in zip(axes, words[1::2], strict=True)}


def number(word: str) -> float:
    """A decimal number; raises `GcsRefusal`."""
    if not _NUMBER.fullmatch(word):
        raise GcsRefusal(GcsError.SYNTAX)
    return float(word)


def lines_reply(lines: Iterable[str]) -> bytes:
    """A reply of several lines: each but the last ends in space and LF, the last in LF."""
    return " \n".join(lines).encode("ascii") + LINE_END


def values_reply(values: dict[str, float]) -> bytes:
    """``AXIS=VALUE`` lines with six decimals."""
    return lines_reply(f"{axis}={value:.6f}" for axis, value in values.items())


def flags_reply(axes: Iterable[str], flag: int) -> bytes:
    """``AXIS=0`` or ``AXIS=1`` lines: the same for all axes, which this robot's are."""
    return lines_reply(f"{axis}={flag:d}" for axis in axes)


def motion_status_reply(moving_axes: int) -> bytes:
    """Bits of the moving axes, hexadecimal."""
    return f"{moving_axes:X}\n".encode("ascii")


def ready_reply(*, ready: bool) -> bytes:
    """0xB1 when ready for commands, 0xB0 when not, then LF."""
    return (b"\xb1" if ready else b"\xb0") + LINE_END
