"""Faults that can be put into the controller, to see what its client makes of them."""

from dataclasses import replace
from enum import StrEnum

from simulation.controller.gcs_protocol import GcsError
from simulation.controller.hexapod_model import HexapodState, power_off, trip

ENCODER_JUMP_MM = 0.8


class Fault(StrEnum):
    """What can go wrong.

    On the line (`line_faults.py`):

    `SILENCE`: neither hears nor answers, as with a pulled cable; a move under way goes on.
    `GARBAGE_REPLY`: answers, but with bytes that are no reply.
    `PARTIAL_REPLY`: the end of every answer is lost.
    `ECHO`: every line comes back before its answer.
    `SLOW_REPLY`: answers come 0.4 s late.
    `DROPPED_BYTES`, `DUPLICATED_BYTES`, `WRONG_BYTES`: one byte in a hundred, both ways, at random.

    In controller and robot:

    `LEG_STALL`: the platform hangs in a move; half a second later the controller lets the servo go, error -1024.
    `LIMIT_SWITCH`: a leg meets its limit switch: brake on, servo off, error 216; no motion while it is pressed.
    `ENCODER_JUMP`: the encoders report 0.8 mm more in X than is true.
    `SERVO_ERROR`: brake on, servo off, error -1024; the servo cannot be switched on.
    `BRAKE_SLIPS`: held by the brake alone, the platform sinks by 0.3 mm; the controller reports that the brake is on.
    `POWER_CYCLE`: no power: braked, silent; with power again, the reference is lost.
    `EMERGENCY_STOP`: brake on, servo off, error 500 as long as it is pressed; once it is released, error 501 once.
    """

    SILENCE = "silence"
    GARBAGE_REPLY = "garbage_reply"
    PARTIAL_REPLY = "partial_reply"
    ECHO = "echo"
    SLOW_REPLY = "slow_reply"
    DROPPED_BYTES = "dropped_bytes"
    DUPLICATED_BYTES = "duplicated_bytes"
    WRONG_BYTES = "wrong_bytes"
    LEG_STALL = "leg_stall"
    LIMIT_SWITCH = "limit_switch"
    ENCODER_JUMP = "encoder_jump"
    SERVO_ERROR = "servo_error"
    BRAKE_SLIPS = "brake_slips"
    POWER_CYCLE = "power_cycle"
    EMERGENCY_STOP = "emergency_stop"


LINE_FAULTS = frozenset(
    {
        Fault.SILENCE,
        Fault.GARBAGE_REPLY,
        Fault.PARTIAL_REPLY,
        Fault.ECHO,
        Fault.SLOW_REPLY,
        Fault.DROPPED_BYTES,
        Fault.DUPLICATED_BYTES,
        Fault.WRONG_BYTES,
    }
)


def with_fault(state: HexapodState, fault: Fault) -> HexapodState:
    """What a fault does to the platform; those of the line do nothing to it."""
    match fault:
        case Fault.LEG_STALL:
            return replace(state, leg_stalled=True)
        case Fault.LIMIT_SWITCH:
            return replace(trip(state, GcsError.LIMIT_SWITCH), limit_switch=True)
        case Fault.ENCODER_JUMP:
            return replace(state, encoder_jump_mm=ENCODER_JUMP_MM)
        case Fault.SERVO_ERROR:
            return replace(trip(state, GcsError.MOTION_ERROR), servo_broken=True)
        case Fault.BRAKE_SLIPS:
            return replace(state, brake_slips=True)
        case Fault.POWER_CYCLE:
            return power_off(state)
        case Fault.EMERGENCY_STOP:
            return replace(trip(state, GcsError.EMERGENCY_STOP), emergency_stop=True)
        case _:
            return _unchanged(state, fault)


def without_fault(state: HexapodState, fault: Fault) -> HexapodState:
    """What mending a fault does to the platform: nothing moves, and nothing is switched on by itself."""
    match fault:
        case Fault.LEG_STALL:
            return replace(state, leg_stalled=False, stalled_for_s=0.0)
        case Fault.LIMIT_SWITCH:
            return replace(state, limit_switch=False)
        case Fault.ENCODER_JUMP:
            return replace(state, encoder_jump_mm=0.0)
        case Fault.SERVO_ERROR:
            return replace(state, servo_broken=False)
        case Fault.BRAKE_SLIPS:
            return replace(state, brake_slips=False, has_slipped=False)
        case Fault.POWER_CYCLE:
            return state
        case Fault.EMERGENCY_STOP:
            return replace(state, emergency_stop=False, error=GcsError.EMERGENCY_STOP_WAS_PRESSED)
        case _:
            return _unchanged(state, fault)


def _unchanged(state: HexapodState, fault: Fault) -> HexapodState:
    if fault not in LINE_FAULTS:
        raise AssertionError(f"'{fault}' is neither a fault of the line nor of the robot")
    return state
