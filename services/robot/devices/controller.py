"""The port to a hexapod controller: what every dialect (`devices/gcs`, ...) implements, and its neutral errors.

A dialect takes a port (`serial_port.Port`), speaks its protocol on it, and reports errors of the controller as
`ControllerError`. It is registered in `dialects.py`; nothing else knows it.
"""

import math
import re
from collections.abc import Sequence
from enum import StrEnum
from typing import Protocol

from services.robot.core.controller_feedback import ControllerFeedback
from shared.errors import DeviceError
from shared.geometry.hexapod import PlatformPose


class StopInForce(DeviceError):
    """A motion command was held back because a stop was asked for before it went out."""

    code = "stop_in_force"


class ControllerSilent(DeviceError):
    """The controller did not answer in time, or the line is gone."""

    code = "controller_silent"


class ControllerFault(DeviceError):
    """The controller reported a fault; it does so once, so that whoever receives this must not drop it."""

    code = "controller_fault"


class ReplyGarbled(DeviceError):
    """The controller answered something that is not an answer to the question."""

    code = "reply_garbled"


# Chosen: what fits into one line of a message.
_SHOWN = 80
# float() would also take 'nan', 'inf', '1_0' and digits of other scripts.
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,3})?", re.ASCII)


def garbled(question: str, lines: Sequence[str]) -> ReplyGarbled:
    """The error for an answer that is none."""
    shown = " | ".join(lines)
    shown = shown if len(shown) <= _SHOWN else shown[:_SHOWN] + "..."
    return ReplyGarbled(
        f"the controller answered {shown!r} to '{question}', which is not an answer to it; check the cable"
    )


def number_in(text: str, question: str, lines: Sequence[str]) -> float:
    """A decimal number of an answer, strictly; raises the error for an answer that is none."""
    value = float(text) if _NUMBER.fullmatch(text.strip(" ")) else math.inf
    if not math.isfinite(value):
        raise garbled(question, lines)
    return value


class Encoders(StrEnum):
    """Absolute encoders know where they are: reference moves nothing. Incremental ones must move for reference."""

    ABSOLUTE = "absolute"
    INCREMENTAL = "incremental"


class HexapodController(Protocol):
    """A connected controller. All but `stop_now` may be called from one thread at a time only.

    A stop is in force from the moment of connection until `release_stop`.
    """

    @property
    def identity(self) -> str:
        """Maker, model and version, as the controller reports them."""

    def read(self) -> ControllerFeedback:
        """Ask for pose, motion, servo, brake, reference and error; raises `DeviceError` on silence or garbage."""

    def reference(self) -> None:
        """Begin reference. Absolute encoders: nothing moves, and the robot stays locked."""

    def move(self, target: PlatformPose, speed_mm_per_s: float) -> None:
        """Unlock (servo on, then brake off) and begin a move.

        Raises
        ------
        StopInForce
            When a stop was asked for: nothing was begun, or what was begun has been stopped.
        DeviceError
            When the controller refuses, stays silent, or reads back another target.
        """

    def lock(self) -> None:
        """Brake on, read back, then servo off, read back; raises `DeviceError` when they are not."""

    def stop_now(self) -> DeviceError | None:
        """Stop abruptly and lock, without waiting for anything: from any thread, at any time. Never raises.

        Returns why the line did not take every byte, None when it did: which proves nothing of the controller.
        """

    def release_stop(self) -> None:
        """Let motion commands through again."""

    def close(self) -> None:
        """Leave the line."""
