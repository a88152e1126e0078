"""PI GCS 2.0 as text: commands to lines, replies to values. Strict: what is not exactly a reply is refused."""

import math
import re
from collections.abc import Mapping, Sequence

from services.robot.devices.controller import garbled, number_in
from shared.errors import DeviceError
from shared.geometry.hexapod import AXES, PlatformPose

MOTION_STATUS = b"\x05"
STOP_ALL = b"\x18"

_HEXADECIMAL = re.compile(r"(0[xX])?[0-9a-fA-F]{1,8}", re.ASCII)


def command(name: str, values: Mapping[str, float | int]) -> bytes:
    """A command with axes and values, e.g. ``MOV X 1.000000 Y 0.000000`` LF."""
    arguments = " ".join(f"{axis} {_number(value)}" for axis, value in values.items())
    return f"{name} {arguments}\n".encode("ascii")


def query(name: str, axes: Sequence[str] = ()) -> bytes:
    """A question, e.g. ``POS? X Y`` LF."""
    return (" ".join((f"{name}?", *axes)) + "\n").encode("ascii")


def pose_values(pose: PlatformPose) -> dict[str, float]:
    """A pose as values by axis."""
    return dict(zip(AXES, (float(v) for v in pose.as_array()), strict=True))


def on_all_axes(value: int) -> dict[str, int]:
    """The same switch for every axis."""
    return dict.fromkeys(AXES, value)


def _number(value: float) -> str:
    if isinstance(value, int):
        return str(value)
    if not math.isfinite(value):
        raise DeviceError(f"{value} is not a finite number and cannot be sent to the controller")
    # A nanometre and a nanodegree: far below the resolution, and short enough for any controller's line buffer.
    return f"{value:.6f}"


def parse_axis_values(lines: Sequence[str], axes: Sequence[str], question: str) -> tuple[float, ...]:
    """Values of ``AXIS=VALUE`` lines, in the order of `axes`; exactly these axes, each once."""
    found: dict[str, float] = {}
    for line in lines:
        axis, equals, text = line.strip(" ").partition("=")
        if not equals or axis not in axes or axis in found:
            raise garbled(question, lines)
        found[axis] = number_in(text, question, lines)
    if len(found) != len(axes):
        raise garbled(question, lines)
    return tuple(found[axis] for axis in axes)


def parse_switches(lines: Sequence[str], axes: Sequence[str], question: str) -> tuple[bool, ...]:
    """Like `parse_axis_values`, for values that are 0 or 1."""
    values = parse_axis_values(lines, axes, question)
    if not set(values) <= {0.0, 1.0}:
        raise garbled(question, lines)
    return tuple(value == 1.0 for value in values)


def parse_pose(lines: Sequence[str], question: str) -> PlatformPose:
    """A pose from ``X=.. Y=.. Z=.. U=.. V=.. W=..``."""
    return PlatformPose(*parse_axis_values(lines, AXES, question))


def parse_number(lines: Sequence[str], question: str) -> float:
    """One bare number."""
    return number_in(_only_line(lines, question), question, lines)


def parse_integer(lines: Sequence[str], question: str) -> int:
    """One bare whole number."""
    text = _only_line(lines, question)
    if not re.fullmatch(r"[+-]?\d{1,6}", text, re.ASCII):
        raise garbled(question, lines)
    return int(text)


def parse_motion_status(lines: Sequence[str]) -> bool:
    """Whether any axis moves, from the answer to the single byte 5: a hexadecimal bit mask of moving axes."""
    text = _only_line(lines, "#5")
    if not _HEXADECIMAL.fullmatch(text):
        raise garbled("#5", lines)
    return int(text, 16) != 0


def parse_axis_names(lines: Sequence[str], question: str) -> tuple[str, ...]:
    """Names of axes, one a line."""
    names = tuple(line.strip(" ") for line in lines)
    if not all(re.fullmatch(r"[A-Za-z0-9]{1,8}", name, re.ASCII) for name in names):
        raise garbled(question, lines)
    return names


def parse_text(lines: Sequence[str], question: str) -> str:
    """One line of printable text."""
    text = _only_line(lines, question)
    if not text or not text.isprintable():
        raise garbled(question, lines)
    return text


def _only_line(lines: Sequence[str], question: str) -> str:
    if len(lines) != 1:
        raise garbled(question, lines)
    return lines[0].strip(" ")
