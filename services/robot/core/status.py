"""What is known of the robot at one moment, and what a new feedback makes of it. Pure."""

from dataclasses import dataclass, replace
from typing import Literal, assert_never

from services.robot.core.controller_feedback import ControllerError, ControllerFeedback
from services.robot.core.deviation import Deviation, deviation
from services.robot.core.motion import Event, next_motion, stop_is_latched
from services.robot.core.refusals import Refusal, RefusalCode, refusal
from services.robot.core.stop_button import after_acknowledgement, after_feedback
from services.robot.core.stop_result import Readback
from services.robot.core.supervision import (
    ExplainedEvent,
    MoveUnderWay,
    check_at_rest,
    check_held,
    check_moving,
    check_referencing,
    reported_error,
)
from services.robot.core.tuning import SUPERVISION
from shared.geometry.hexapod import PlatformPose
from shared.robot_states import MotionState, StopButton

Outcome = Literal["none", "moving", "reached", "stopped", "failed"]

UNDER_WAY = (MotionState.MOVING, MotionState.REFERENCING)
ACKNOWLEDGEMENTS = (Event.ACKNOWLEDGE_REFERENCED, Event.ACKNOWLEDGE_UNREFERENCED)
# Chosen: as many as a person reads; a noisy line may give a new one in every round.
_MOST_FURTHER_FAULTS = 3
_THEN = "; then: "
_HELD = frozenset({MotionState.LOCKED, MotionState.STOPPED})


@dataclass(frozen=True, slots=True)
class ReferenceUnderWay:
    """Reference that is being carried out: where the robot stood, how far it may move, and when it began."""

    before: PlatformPose
    allowed: Deviation
    began_s: float


@dataclass(frozen=True, slots=True)
class DriveStatus:
    """Everything known of the robot at one moment. All times are of the service's own monotonic clock.

    Attributes
    ----------
    generation
        Counts transitions: feedback of an older generation does not describe the present state.
    feedback
        What the controller last reported; None when it is not known.
    feedback_generation, feedback_s
        Under which generation, and when, that feedback was begun.
    connected_s
        When the controller was last connected.
    task
        What is under way, or was last.
    command_id, outcome, deviation
        The command under way, or the last one, and how it ended.
    held
        Where the robot was when it was first seen locked, also while a stop that came then is in force and after it;
        None in states that need not hold it.
    stop_button
        The button on the controller itself.
    stops
        How often a state was entered in which the stop is in force.
    readback
        The newest complete round of the controller's answers, of whatever generation; None before the first.
    """

    state: MotionState = MotionState.DISCONNECTED
    detail: str = "the service has just started"
    generation: int = 0
    feedback: ControllerFeedback | None = None
    feedback_generation: int = -1
    feedback_s: float = 0.0
    identity: str = ""
    connected_s: float = 0.0
    task: MoveUnderWay | ReferenceUnderWay | None = None
    command_id: str | None = None
    outcome: Outcome = "none"
    deviation: Deviation | None = None
    held: PlatformPose | None = None
    stop_button: StopButton = StopButton.RELEASED
    stops: int = 0
    readback: Readback | None = None

    def fresh_feedback(self, now_s: float) -> ControllerFeedback | None:
        """The feedback, unless it is older than half a second or than the present state."""
        is_fresh = (
            self.feedback_generation == self.generation and now_s - self.feedback_s <= SUPERVISION.oldest_feedback_s
        )
        return self.feedback if is_fresh else None

    def after_transition(self, event: Event, state: MotionState, detail: str) -> "DriveStatus":
        """The status right after an event of the motion table."""
        return replace(
            self,
            state=state,
            # People press stop in fault as well: what is wrong, and what to do about it, must stand until the reset.
            detail=self.detail if event is Event.STOP and self.state is MotionState.FAULT else detail,
            generation=self.generation + 1,
            stops=self.stops + int(stop_is_latched(state)),
            outcome=_outcome_after(self.outcome, event, state),
            # A stop at rest lets nothing go: the guide stays where it was locked, until and after it is acknowledged.
            held=self.held if {self.state, state} <= _HELD else None,
            stop_button=after_acknowledgement(self.stop_button) if event in ACKNOWLEDGEMENTS else self.stop_button,
        )


def locked_feedback(status: DriveStatus, event: Event, now_s: float) -> ControllerFeedback | Refusal:
    """A fresh feedback of a robot that is locked at rest, for an `event` that the motion table allows."""
    planned = next_motion(status.state, event)
    if isinstance(planned, Refusal):
        return planned
    if event in ACKNOWLEDGEMENTS and status.stop_button is StopButton.PRESSED:
        return refusal(
            RefusalCode.STOP_BUTTON_PRESSED,
            "the controller's stop button is pressed",
        )
    feedback = status.fresh_feedback(now_s)
    if feedback is None:
        return refusal(RefusalCode.POSE_UNKNOWN, "the controller has not answered just now")
    if not feedback.locked or feedback.moving:
        return refusal(RefusalCode.NOT_LOCKED, "the robot is not locked at rest yet")
    return feedback


def with_feedback(
    status: DriveStatus, feedback: ControllerFeedback, began_s: float, now_s: float
) -> tuple[DriveStatus, ExplainedEvent | None]:
    """Take in feedback that was asked for under the present generation; the event it means is still to happen."""
    button = after_feedback(status.stop_button, feedback.error)
    status = replace(
        status, feedback=feedback, feedback_generation=status.generation, feedback_s=began_s, stop_button=button
    )
    match status.state:
        case MotionState.MOVING:
            return _while_moving(status, feedback, now_s)
        case MotionState.REFERENCING:
            return status, _while_referencing(status, feedback, now_s)
        case MotionState.LOCKED | MotionState.UNREFERENCED | MotionState.STOPPED:
            finding = check_at_rest(status.state, feedback)
            return (status, finding) if finding else _while_held(status, feedback)
        case MotionState.FAULT:
            return _with_further_error(status, feedback.error), None
        case MotionState.DISCONNECTED:
            return status, None
        case _:
            assert_never(status.state)


def with_overtaken_error(
    status: DriveStatus, error: ControllerError | None
) -> tuple[DriveStatus, ExplainedEvent | None]:
    """Take in the error of a round that an event has overtaken; the event it means is still to happen.

    Where the robot was in that round does not matter any more. Its error does: the controller reports it once.
    """
    if error is None:
        return status, None
    status = replace(status, stop_button=after_feedback(status.stop_button, error))
    if status.state is MotionState.FAULT:
        return _with_further_error(status, error), None
    if error.is_stop and stop_is_latched(status.state):
        return status, None
    return status, reported_error(error)


def _with_further_error(status: DriveStatus, error: ControllerError | None) -> DriveStatus:
    return status if error is None or error.is_stop else with_further_fault(status, error.message)


def with_further_fault(status: DriveStatus, message: str) -> DriveStatus:
    """The first fault's sentence stays; what the controller reports after it stands behind, up to a number."""
    if message in status.detail or status.detail.count(_THEN) >= _MOST_FURTHER_FAULTS:
        return status
    return replace(status, detail=f"{status.detail}{_THEN}{message}")


def _while_moving(
    status: DriveStatus, feedback: ControllerFeedback, now_s: float
) -> tuple[DriveStatus, ExplainedEvent | None]:
    if not isinstance(status.task, MoveUnderWay):
        return status, ExplainedEvent(
            Event.FAULT_SEEN, "the robot is moving without a permitted move; keep clear of it"
        )
    at_rest_s = None if feedback.moving else (status.task.at_rest_s or now_s)
    move = replace(status.task, at_rest_s=at_rest_s)
    return replace(status, task=move), check_moving(move, feedback, now_s)


def _while_referencing(status: DriveStatus, feedback: ControllerFeedback, now_s: float) -> ExplainedEvent | None:
    if not isinstance(status.task, ReferenceUnderWay):
        return ExplainedEvent(Event.FAULT_SEEN, "the robot is being referenced without a request; keep clear of it")
    return check_referencing(status.task.before, feedback, now_s - status.task.began_s, status.task.allowed)


def _while_held(status: DriveStatus, feedback: ControllerFeedback) -> tuple[DriveStatus, ExplainedEvent | None]:
    """Where it was locked the robot must stay: that is what makes it a guide."""
    if status.held is not None:
        return status, check_held(status.held, feedback)
    if status.state is not MotionState.LOCKED:
        return status, None
    return _read_back(replace(status, held=feedback.pose), feedback)


def _read_back(status: DriveStatus, feedback: ControllerFeedback) -> tuple[DriveStatus, ExplainedEvent | None]:
    """Compare once more after locking: that is where the guide is held."""
    if status.outcome != "moving":
        return status, None
    if not isinstance(status.task, MoveUnderWay):
        return replace(status, outcome="reached"), None
    off = deviation(status.task.permitted.target, feedback.pose)
    status = replace(status, deviation=off)
    if off.exceeds(SUPERVISION.read_back):
        return status, ExplainedEvent(
            Event.FAULT_SEEN,
            f"locking moved the robot {off} from its target (limits {SUPERVISION.read_back}); check the brakes",
        )
    return replace(status, outcome="reached", detail=f"on the target within {off}, locked"), None


def _outcome_after(outcome: Outcome, event: Event, state: MotionState) -> Outcome:
    if outcome != "moving" or state in (*UNDER_WAY, MotionState.LOCKED):
        return outcome
    return "stopped" if state is MotionState.STOPPED or event is Event.SHUT_DOWN else "failed"
