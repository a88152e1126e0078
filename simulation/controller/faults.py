"""Faults that can be put into the controller, to see what its client makes of them."""

from dataclasses import replace
from enum import StrEnum
from typing import assert_never

from simulation.controller.gcs_protocol import GcsError
from simulation.controller.hexapod_model import HexapodState, trip


class Fault(StrEnum):
    """What can go wrong.

    `SILENCE`: neither hears nor answers, as with a pulled cable; a move under way goes on.
    `GARBAGE_REPLY`: answers, but with bytes that are no reply.
    `LEG_STALL`: the platform hangs in a move; half a second later the controller lets the servo go, error -1024.
    `SERVO_ERROR`: brake on, servo off, error -1024; the servo cannot be switched on.
    `EMERGENCY_STOP`: brake on, servo off, error 500; neither can be changed while it is pressed.
    """

    SILENCE = "silence"
    GARBAGE_REPLY = "garbage_reply"
    LEG_STALL = "leg_stall"
    SERVO_ERROR = "servo_error"
    EMERGENCY_STOP = "emergency_stop"


def with_fault(state: HexapodState, fault: Fault) -> HexapodState:
    """What a fault does to the platform; those of the line do nothing to it."""
    match fault:
        case Fault.SILENCE | Fault.GARBAGE_REPLY:
            return state
        case Fault.LEG_STALL:
            return replace(state, leg_stalled=True)
        case Fault.SERVO_ERROR:
            return replace(trip(state, GcsError.MOTION_ERROR), servo_broken=True)
        case Fault.EMERGENCY_STOP:
            return replace(trip(state, GcsError.EMERGENCY_STOP), emergency_stop=True)
        case _:
            assert_never(fault)


def without_fault(state: HexapodState, fault: Fault) -> HexapodState:
    """What mending a fault does to the platform: nothing moves, and nothing is switched on by itself."""
    match fault:
        case Fault.SILENCE | Fault.GARBAGE_REPLY:
            return state
        case Fault.LEG_STALL:
            return replace(state, leg_stalled=False, stalled_for_s=0.0)
        case Fault.SERVO_ERROR:
            return replace(state, servo_broken=False)
        case Fault.EMERGENCY_STOP:
            return replace(state, emergency_stop=False)
        case _:
            assert_never(fault)
