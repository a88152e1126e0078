"""The robot as last seen on the bus, with its age: stale data must be visible as stale."""

from dataclasses import dataclass, replace
from enum import StrEnum

from services.ui_api.core.operations import RobotSaying
from services.ui_api.core.robot_event_data import RobotChanged
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.refusals import RefusalKind, Refused
from shared.messages.robot import MotionState, RobotState, StopLatch

IN_MOTION = frozenset({MotionState.MOVING, MotionState.REFERENCING})


class Validity(StrEnum):
    """Whether a value may be relied on."""

    CURRENT = "current"
    STALE = "stale"
    ABSENT = "absent"


@dataclass(frozen=True, slots=True)
class SeenRobot:
    """A robot state and when it arrived here, on this host's monotonic clock."""

    state: RobotState
    arrived_at_s: float


class RobotView:
    """Keeps the newest robot state. Written by the bus's thread, read by all others."""

    def __init__(self, clock: Clock, stale_after_s: float) -> None:
        self._clock = clock
        self.stale_after_s = stale_after_s
        self._seen: SeenRobot | None = None

    def note(self, state: RobotState) -> bool:
        """Take a state in; True when its condition differs from the one before, not only pose, time or wording."""
        before = self._seen
        self._seen = SeenRobot(state, self._clock.monotonic_s())
        return before is None or _condition(before.state) != _condition(state)

    def newest(self) -> SeenRobot | None:
        """The newest state, however old."""
        return self._seen

    def age_s(self) -> float | None:
        """Time since the newest state arrived; None before the first."""
        seen = self._seen
        return None if seen is None else self._clock.monotonic_s() - seen.arrived_at_s

    def validity(self) -> Validity:
        """Whether the newest state may be relied on."""
        age_s = self.age_s()
        if age_s is None:
            return Validity.ABSENT
        return Validity.CURRENT if age_s <= self.stale_after_s else Validity.STALE

    def current(self) -> RobotState:
        """The newest state if it is fresh; raises `Refused` otherwise."""
        seen, age_s = self._seen, self.age_s()
        if seen is None or age_s is None:
            raise Refused(
                RefusalKind.UNAVAILABLE, "robot_absent", "the robot service has not reported its state; start it"
            )
        if age_s > self.stale_after_s:
            raise Refused(
                RefusalKind.UNAVAILABLE,
                "robot_state_stale",
                f"the robot's newest state is {age_s:.1f} s old (limit {self.stale_after_s:g} s); check its service "
                "and the link",
            )
        return seen.state


def change_of(state: RobotState) -> RobotChanged:
    """What of a robot state is worth an event when it changes."""
    return RobotChanged(
        boot_epoch=state.boot_epoch,
        state=state.state,
        stop=state.stop,
        locked=state.locked,
        referenced=state.referenced,
        command_id=state.command_id,
        outcome=state.outcome,
        detail=state.detail,
        controller_identity=state.controller_identity,
        # Of the motion under way alone: later cases must not go on naming a permit that belongs to this one.
        permit_sha256=state.permit_sha256 if state.state in IN_MOTION else None,
        permits_refused=state.permits_refused,
        permit_refusal=state.permit_refusal,
    )


def _condition(state: RobotState) -> RobotChanged:
    return replace(change_of(state), detail="")


def saying_of(state: RobotState) -> RobotSaying:
    """What a robot state says about commands."""
    return RobotSaying(
        boot_epoch=state.boot_epoch,
        sequence=state.sequence,
        clock_s=state.clock_s,
        command_id=state.command_id,
        outcome=state.outcome,
        at_rest=state.state not in IN_MOTION,
        stop_latched=state.stop is StopLatch.LATCHED,
        in_fault=state.state is MotionState.FAULT,
        detail=state.detail,
        deviation_mm=state.deviation_mm,
        deviation_deg=state.deviation_deg,
        connected=state.state is not MotionState.DISCONNECTED,
    )
