"""The motion table: what the robot may do next, whatever happens. Pure, and total over all pairs of state and event.

Two rules hold by construction and are tested over all pairs: `moving` is entered from `locked` alone, and every entry
into a state at rest locks (brakes on, servo off). The stop button's latch is in force in `disconnected`, `stopped` and
`fault`, and `disconnected` leads only to `stopped`: the service starts with the button pressed, and nothing but a
person's acknowledgement releases it.
"""

from dataclasses import dataclass
from enum import StrEnum

from services.robot.core.refusals import Refusal, RefusalCode, refusal
from shared.robot_states import MotionState


class Event(StrEnum):
    """What can happen."""

    CONNECTED = "connected"
    STOP = "stop"
    SUPERVISION_LOST = "supervision_lost"
    CONTROLLER_STOPPED = "controller_stopped"
    FAULT_SEEN = "fault_seen"
    MOVE = "move"
    ARRIVED = "arrived"
    REFERENCE = "reference"
    REFERENCE_DONE = "reference_done"
    ACKNOWLEDGE_REFERENCED = "acknowledge_referenced"
    ACKNOWLEDGE_UNREFERENCED = "acknowledge_unreferenced"
    RESET = "reset"
    SHUT_DOWN = "shut_down"


class Effect(StrEnum):
    """What is to be done about it, in the order given."""

    STOP_NOW = "stop_now"
    LOCK = "lock"
    RELEASE_STOP = "release_stop"
    START_MOVE = "start_move"
    START_REFERENCE = "start_reference"
    DISCONNECT = "disconnect"


@dataclass(frozen=True, slots=True)
class Transition:
    """The state after an event, and what to do."""

    state: MotionState
    effects: tuple[Effect, ...] = ()


MEANINGS = {
    Event.CONNECTED: "the controller answers, and was found or made stopped and locked",
    Event.STOP: "somebody asks for a stop",
    Event.SUPERVISION_LOST: "the gateway's heartbeat is late, or the link or the router is lost",
    Event.CONTROLLER_STOPPED: "the controller reports a stop that nobody here asked for (its own stop button)",
    Event.FAULT_SEEN: "silence or garbage from the controller, a brake that does not hold, a missed target, ...",
    Event.MOVE: "a move that the guard has let pass",
    Event.ARRIVED: "at rest, on the target, read back within tolerance",
    Event.REFERENCE: "somebody asks for reference",
    Event.REFERENCE_DONE: "all axes are referenced",
    Event.ACKNOWLEDGE_REFERENCED: "a person acknowledges the stop; the axes are referenced",
    Event.ACKNOWLEDGE_UNREFERENCED: "a person acknowledges the stop; the axes are not referenced",
    Event.RESET: "a person has seen to the fault; connect anew",
    Event.SHUT_DOWN: "the service leaves",
}
REQUESTS = (
    Event.MOVE,
    Event.REFERENCE,
    Event.ACKNOWLEDGE_REFERENCED,
    Event.ACKNOWLEDGE_UNREFERENCED,
    Event.RESET,
)

_STOP_AND_LOCK = (Effect.STOP_NOW, Effect.LOCK)
_UNDER_WAY = (MotionState.MOVING, MotionState.REFERENCING)
_CONNECTED_STATES = tuple(s for s in MotionState if s is not MotionState.DISCONNECTED)
_STOPPABLE = tuple(s for s in _CONNECTED_STATES if s is not MotionState.FAULT)


def _table() -> dict[tuple[MotionState, Event], Transition]:
    """Every legal pair."""
    s, e = MotionState, Event
    table = {
        (s.DISCONNECTED, e.CONNECTED): Transition(s.STOPPED, (Effect.LOCK,)),
        (s.DISCONNECTED, e.STOP): Transition(s.DISCONNECTED, (Effect.STOP_NOW,)),
        (s.LOCKED, e.MOVE): Transition(s.MOVING, (Effect.START_MOVE,)),
        (s.MOVING, e.ARRIVED): Transition(s.LOCKED, (Effect.LOCK,)),
        (s.UNREFERENCED, e.REFERENCE): Transition(s.REFERENCING, (Effect.START_REFERENCE,)),
        (s.REFERENCING, e.REFERENCE_DONE): Transition(s.LOCKED, (Effect.LOCK,)),
        (s.STOPPED, e.ACKNOWLEDGE_REFERENCED): Transition(s.LOCKED, (Effect.LOCK, Effect.RELEASE_STOP)),
        (s.STOPPED, e.ACKNOWLEDGE_UNREFERENCED): Transition(s.UNREFERENCED, (Effect.LOCK, Effect.RELEASE_STOP)),
        (s.FAULT, e.RESET): Transition(s.DISCONNECTED, (*_STOP_AND_LOCK, Effect.DISCONNECT)),
        (s.FAULT, e.STOP): Transition(s.FAULT, _STOP_AND_LOCK),
        (s.FAULT, e.CONTROLLER_STOPPED): Transition(s.FAULT),
    }
    table |= {(state, e.STOP): Transition(s.STOPPED, _STOP_AND_LOCK) for state in _STOPPABLE}
    table |= {(state, e.CONTROLLER_STOPPED): Transition(s.STOPPED, _STOP_AND_LOCK) for state in _STOPPABLE}
    table |= {(state, e.FAULT_SEEN): Transition(s.FAULT, _STOP_AND_LOCK) for state in _CONNECTED_STATES}
    table |= {(state, e.SUPERVISION_LOST): Transition(state) for state in MotionState}
    table |= {(state, e.SUPERVISION_LOST): Transition(s.STOPPED, _STOP_AND_LOCK) for state in _UNDER_WAY}
    table |= {
        (state, e.SHUT_DOWN): Transition(s.DISCONNECTED, (*_STOP_AND_LOCK, Effect.DISCONNECT)) for state in MotionState
    }
    return table


TABLE = _table()

_WHY_NOT = {
    MotionState.DISCONNECTED: (RefusalCode.NOT_CONNECTED, "the controller is not connected"),
    MotionState.UNREFERENCED: (RefusalCode.NOT_REFERENCED, "the axes are not referenced"),
    MotionState.REFERENCING: (RefusalCode.BUSY, "reference is under way"),
    MotionState.LOCKED: (RefusalCode.NOTHING_TO_DO, "the robot is locked, referenced and free of faults already"),
    MotionState.MOVING: (RefusalCode.BUSY, "a move is under way"),
    MotionState.STOPPED: (
        RefusalCode.STOP_IN_FORCE,
        "a stop is in force",
    ),
    MotionState.FAULT: (RefusalCode.IN_FAULT, "the robot is in fault"),
}


def next_motion(state: MotionState, event: Event) -> Transition | Refusal:
    """What follows when `event` happens in `state`: a transition, or a refusal with its reason."""
    transition = TABLE.get((state, event))
    if transition is not None:
        return transition
    code, why = _WHY_NOT[state]
    asked = event.value.replace("_", " ")
    return refusal(code, f"'{asked}' is not possible in the state '{state.value}': {why}")


def stop_is_latched(state: MotionState) -> bool:
    """Whether the stop button counts as pressed."""
    return state in {MotionState.DISCONNECTED, MotionState.STOPPED, MotionState.FAULT}


def motion_table_markdown() -> str:
    """The whole table as it stands in `docs/safety.md`: a row per event, a column per state."""
    lines = [
        "| event | " + " | ".join(f"`{s.value}`" for s in MotionState) + " |",
        "|---" * (len(MotionState) + 1) + "|",
    ]
    for event in Event:
        cells = [_cell(next_motion(state, event)) for state in MotionState]
        lines.append(f"| `{event.value}`: {MEANINGS[event]} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _cell(outcome: Transition | Refusal) -> str:
    if isinstance(outcome, Refusal):
        return f"refused: {outcome.code.value}"
    effects = ", ".join(e.value for e in outcome.effects)
    return f"**{outcome.state.value}**" + (f": {effects}" if effects else "")
