"""What each GCS command does to the hexapod: (state, words) -> (state, reply). Pure, one function per command."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from shared.geometry.hexapod import AXES, HexapodPart
from shared.geometry.hexapod_workspace import travel_range
from simulation.controller import hexapod_model as model
from simulation.controller.gcs_protocol import (
    GcsError,
    GcsRefusal,
    Line,
    SingleByte,
    axes_of,
    axis_values,
    flags_reply,
    lines_reply,
    motion_status_reply,
    number,
    ready_reply,
    values_reply,
)
from simulation.controller.hexapod_model import Encoders, HexapodState
from simulation.controller.moves import Purpose, Vector

IDENTITY = "(c) distalock (simulated), virtual hexapod, 0, 1.0.0"
PIVOT_AXES = ("R", "S", "T")
RESOLUTION = 0.001
_ALL_MOVING = 0x3F
Words = Sequence[str]
Outcome = tuple[HexapodState, bytes]


@dataclass(frozen=True, slots=True, eq=False)
class Controller:
    """What does not change while the controller runs."""

    hexapod: HexapodPart
    encoders: Encoders


def obey(controller: Controller, state: HexapodState, line: Line) -> Outcome:
    """Carry out one line; what cannot be obeyed changes nothing but the error code."""
    command = _COMMANDS.get(line.mnemonic)
    if command is None:
        return model.with_error(state, GcsError.UNKNOWN_COMMAND), b""
    try:
        return command.run(controller, state, line.words)
    except GcsRefusal as refusal:
        return model.with_error(state, refusal.error), b""


def obey_byte(state: HexapodState, byte: SingleByte) -> Outcome:
    """Carry out a single-byte command."""
    match byte:
        case SingleByte.MOTION_STATUS:
            return state, motion_status_reply(_ALL_MOVING if state.move else 0)
        case SingleByte.READY:
            referencing = state.move is not None and state.move.purpose is Purpose.REFERENCE
            return state, ready_reply(ready=not referencing)
        case SingleByte.STOP_ALL:
            return model.stop(state), b""


def _identity(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    _no_words(words)
    return state, lines_reply([IDENTITY])


def _error(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    _no_words(words)
    # What has not ended is reported again: the button is still pressed.
    left = GcsError.EMERGENCY_STOP if state.emergency_stop else GcsError.NONE
    return model.with_error(state, left), lines_reply([str(int(state.error))])


def _syntax_version(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    _no_words(words)
    return state, lines_reply(["2.0"])


def _versions(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    _no_words(words)
    return state, lines_reply(["Firmware: virtual hexapod 1.0.0", "Protocol: GCS 2.0"])


def _help(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    _no_words(words)
    singles = ["#5 Request Motion Status", "#7 Request Controller Ready Status", "#24 Stop All Axes"]
    commands = [f"{mnemonic} {command.help}" for mnemonic, command in sorted(_COMMANDS.items())]
    return state, lines_reply(["The following commands are valid:", *singles, *commands, "end of help"])


def _axes(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    if tuple(words) not in ((), ("ALL",)):
        raise GcsRefusal(GcsError.SYNTAX)
    return state, lines_reply(AXES)


def _servo(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    return (model.switch_servo_on(state) if _same_flag(words) else model.switch_servo_off(state)), b""


def _brake(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    return (model.apply_brake(state) if _same_flag(words) else model.release_brake(state)), b""


def _servo_query(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    return state, flags_reply(axes_of(words, AXES), state.servo_on)


def _brake_query(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    return state, flags_reply(axes_of(words, AXES), state.brake_on)


def _reference(c: Controller, state: HexapodState, words: Words) -> Outcome:
    axes_of(words, AXES)
    return model.reference(c.hexapod, state, c.encoders), b""


def _reference_query(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    return state, flags_reply(axes_of(words, AXES), state.referenced)


def _move(c: Controller, state: HexapodState, words: Words) -> Outcome:
    return model.command_move(c.hexapod, state, _with_values(state.target, axis_values(words, AXES))), b""


def _move_query(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    return state, _axis_reply(state.target, words)


def _position(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    return state, _axis_reply(np.round(state.measured / RESOLUTION) * RESOLUTION + 0.0, words)


def _on_target(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    return state, flags_reply(axes_of(words, AXES), state.on_target)


def _possible(c: Controller, state: HexapodState, words: Words) -> Outcome:
    target = _with_values(state.target, axis_values(words, AXES))
    return state, lines_reply(["1" if model.reachable(c.hexapod, state, target) else "0"])


def _velocity(c: Controller, state: HexapodState, words: Words) -> Outcome:
    if len(words) != 1:
        raise GcsRefusal(GcsError.SYNTAX)
    return model.set_velocity(c.hexapod, state, number(words[0])), b""


def _velocity_query(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    _no_words(words)
    return state, lines_reply([f"{state.velocity_mm_per_s:.6f}"])


def _pivot(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    values = axis_values(words, PIVOT_AXES)
    pivot = [values.get(axis, now) for axis, now in zip(PIVOT_AXES, state.pivot_mm, strict=True)]
    return model.set_pivot(state, np.array(pivot)), b""


def _pivot_query(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    values = dict(zip(PIVOT_AXES, state.pivot_mm, strict=True))
    return state, values_reply({axis: values[axis] for axis in axes_of(words, PIVOT_AXES)})


def _lowest(c: Controller, state: HexapodState, words: Words) -> Outcome:
    return state, _axis_reply(_travel(c.hexapod, tuple(state.pivot_mm))[0], words)


def _highest(c: Controller, state: HexapodState, words: Words) -> Outcome:
    return state, _axis_reply(_travel(c.hexapod, tuple(state.pivot_mm))[1], words)


def _halt(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    axes_of(words, AXES)
    return model.halt(state), b""


def _stop(_c: Controller, state: HexapodState, words: Words) -> Outcome:
    _no_words(words)
    return model.stop(state), b""


def _no_words(words: Words) -> None:
    if words:
        raise GcsRefusal(GcsError.SYNTAX)


def _same_flag(words: Words) -> bool:
    """Servo and brake act on the whole platform: any axis stands for all, and values must not differ."""
    values = set(axis_values(words, AXES).values())
    if len(values) != 1 or not values <= {0.0, 1.0}:
        raise GcsRefusal(GcsError.VALUE_OUT_OF_RANGE)
    return values == {1.0}


def _with_values(pose: Vector, values: dict[str, float]) -> Vector:
    return np.array([values.get(axis, now) for axis, now in zip(AXES, pose, strict=True)])


def _axis_reply(pose: Vector, words: Words) -> bytes:
    values = dict(zip(AXES, pose, strict=True))
    return values_reply({axis: values[axis] for axis in axes_of(words, AXES)})


@cache
def _travel(hexapod: HexapodPart, pivot_mm: tuple[float, ...]) -> tuple[Vector, Vector]:
    lowest, highest = travel_range(hexapod, np.array(pivot_mm))
    return lowest.as_array(), highest.as_array()


@dataclass(frozen=True, slots=True)
class _Command:
    run: Callable[[Controller, HexapodState, Words], Outcome]
    help: str


_COMMANDS: dict[str, _Command] = {
    "*IDN?": _Command(_identity, "Get Device Identification"),
    "BRA": _Command(_brake, "{<AxisID> <BrakeState>} Set Brake Activation State"),
    "BRA?": _Command(_brake_query, "[{<AxisID>}] Get Brake Activation State"),
    "CSV?": _Command(_syntax_version, "Get Current Syntax Version"),
    "ERR?": _Command(_error, "Get Error Number"),
    "FRF": _Command(_reference, "[{<AxisID>}] Fast Reference Move To Reference Switch"),
    "FRF?": _Command(_reference_query, "[{<AxisID>}] Get Referencing Result"),
    "HLP?": _Command(_help, "Get List Of Available Commands"),
    "HLT": _Command(_halt, "[{<AxisID>}] Halt Motion Smoothly"),
    "MOV": _Command(_move, "{<AxisID> <Position>} Set Target Position"),
    "MOV?": _Command(_move_query, "[{<AxisID>}] Get Target Position"),
    "ONT?": _Command(_on_target, "[{<AxisID>}] Get On-Target State"),
    "POS?": _Command(_position, "[{<AxisID>}] Get Real Position"),
    "SAI?": _Command(_axes, "[ALL] Get List Of Current Axis Identifiers"),
    "SPI": _Command(_pivot, "{<PPCoordinate> <Position>} Set Pivot Point"),
    "SPI?": _Command(_pivot_query, "[{<PPCoordinate>}] Get Pivot Point"),
    "STP": _Command(_stop, "Stop All Axes Abruptly"),
    "SVO": _Command(_servo, "{<AxisID> <ServoState>} Set Servo Mode"),
    "SVO?": _Command(_servo_query, "[{<AxisID>}] Get Servo Mode"),
    "TMN?": _Command(_lowest, "[{<AxisID>}] Get Minimum Commandable Position"),
    "TMX?": _Command(_highest, "[{<AxisID>}] Get Maximum Commandable Position"),
    "VER?": _Command(_versions, "Get Versions Of Firmware And Protocol"),
    "VLS": _Command(_velocity, "<SystemVelocity> Set System Velocity"),
    "VLS?": _Command(_velocity_query, "Get System Velocity"),
    "VMO?": _Command(_possible, "{<AxisID> <Position>} Virtual Move"),
}
