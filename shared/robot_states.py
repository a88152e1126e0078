"""States of the robot, and what it is asked for: the same values in its core, on the bus and at the consoles."""

from enum import StrEnum
from typing import Literal

Verb = Literal["move", "stop", "reference", "acknowledge_stop", "reset"]


class MotionState(StrEnum):
    """States of the hexapod, as in the motion table."""

    DISCONNECTED = "disconnected"
    UNREFERENCED = "unreferenced"
    REFERENCING = "referencing"
    LOCKED = "locked"
    MOVING = "moving"
    STOPPED = "stopped"
    FAULT = "fault"


class StopLatch(StrEnum):
    """The stop button: it latches until a person acknowledges it, and services start with it pressed."""

    CLEAR = "clear"
    LATCHED = "latched"


class StopButton(StrEnum):
    """The button on the hexapod's controller itself; `released` means that nobody has acknowledged it yet."""

    ABSENT = "absent"
    PRESSED = "pressed"
    RELEASED = "released"
    CLEAR = "clear"
