"""Supervise the robot: which event of the motion table the controller's feedback means, if any. Pure."""

from dataclasses import dataclass

import numpy as np

from services.robot.core.controller_feedback import ControllerError, ControllerFeedback
from services.robot.core.deviation import Deviation, deviation
from services.robot.core.guard import PermittedMove
from services.robot.core.motion import Event
from services.robot.core.tuning import SUPERVISION
from shared.geometry.hexapod import PlatformPose
from shared.robot_states import MotionState


@dataclass(frozen=True, slots=True)
class ExplainedEvent:
    """An event and the sentence that explains it."""

    event: Event
    message: str


@dataclass(frozen=True, slots=True)
class MoveUnderWay:
    """The move that is being carried out.

    Attributes
    ----------
    began_s, at_rest_s
        Own monotonic clock: begin, and since when the controller has reported that nothing moves (None while it moves).
    """

    permitted: PermittedMove
    began_s: float
    at_rest_s: float | None = None

    @property
    def longest_s(self) -> float:
        """How long it may take."""
        return SUPERVISION.duration_factor * self.permitted.duration_s + SUPERVISION.duration_margin_s


def reported_error(error: ControllerError | None) -> ExplainedEvent | None:
    """What an error of the controller means while something is under way; None for no error."""
    if error is None:
        return None
    if error.is_stop:
        return ExplainedEvent(Event.CONTROLLER_STOPPED, f"not by this service: {error.message}")
    return ExplainedEvent(Event.FAULT_SEEN, error.message)


def check_at_rest(state: MotionState, feedback: ControllerFeedback) -> ExplainedEvent | None:
    """Check a robot that is to stand still and locked (`locked`, `unreferenced`, `stopped`)."""
    if feedback.moving:
        return ExplainedEvent(Event.FAULT_SEEN, f"the robot moves in the state '{state.value}'; keep clear of it")
    was_stopped = state is MotionState.STOPPED and feedback.error is not None and feedback.error.is_stop
    if not was_stopped and (error := reported_error(feedback.error)):
        return error
    if not feedback.locked:
        return ExplainedEvent(
            Event.FAULT_SEEN,
            f"a brake is off or a servo is on in the state '{state.value}': the guide is not held; "
            "do not drill, check the brakes",
        )
    if state is MotionState.LOCKED and not feedback.referenced:
        return ExplainedEvent(
            Event.FAULT_SEEN, "the axes have lost their reference; reset, reference, take an image again"
        )
    return None


def check_held(held: PlatformPose, feedback: ControllerFeedback) -> ExplainedEvent | None:
    """Check that a locked robot is still where it was when it was locked."""
    off = deviation(held, feedback.pose)
    if not off.exceeds(SUPERVISION.read_back):
        return None
    return ExplainedEvent(
        Event.FAULT_SEEN,
        f"the locked robot has moved by {off} (limits {SUPERVISION.read_back}): a brake slips or an encoder is wrong; "
        "do not drill, check the brakes, then reset and take an image again",
    )


def check_moving(move: MoveUnderWay, feedback: ControllerFeedback, now_s: float) -> ExplainedEvent | None:
    """Check a robot that is carrying out a move; None means go on."""
    if error := reported_error(feedback.error):
        return error
    if not (feedback.unlocked and feedback.referenced):
        return ExplainedEvent(
            Event.FAULT_SEEN, "a servo, a brake or the reference was lost during the move; reset the robot"
        )
    aside = distance_from_path(move.permitted.start, move.permitted.target, feedback.pose)
    if aside.exceeds(SUPERVISION.path):
        return ExplainedEvent(
            Event.FAULT_SEEN, f"the robot was {aside} beside its path (limits {SUPERVISION.path}); check its legs"
        )
    if feedback.moving or not feedback.on_target:
        return _overdue(move, feedback, now_s)
    off = deviation(move.permitted.target, feedback.pose)
    if off.exceeds(SUPERVISION.read_back):
        return ExplainedEvent(
            Event.FAULT_SEEN, f"the move ended {off} from its target (limits {SUPERVISION.read_back}); check the legs"
        )
    return ExplainedEvent(Event.ARRIVED, f"on the target within {off}")


def _overdue(move: MoveUnderWay, feedback: ControllerFeedback, now_s: float) -> ExplainedEvent | None:
    lasted_s = now_s - move.began_s
    if lasted_s > move.longest_s:
        return ExplainedEvent(
            Event.FAULT_SEEN,
            f"the move has taken {lasted_s:.1f} s (limit {move.longest_s:.1f} s); something holds the robot",
        )
    if move.at_rest_s is not None and now_s - move.at_rest_s > SUPERVISION.settle_s:
        off = deviation(move.permitted.target, feedback.pose)
        return ExplainedEvent(
            Event.FAULT_SEEN,
            f"the robot stopped {off} from its target and does not report it reached; something holds it",
        )
    return None


def check_referencing(
    before: PlatformPose, feedback: ControllerFeedback, lasted_s: float, allowed: Deviation
) -> ExplainedEvent | None:
    """Check a robot that is being referenced; it may move by `allowed` (nothing, with absolute encoders)."""
    if error := reported_error(feedback.error):
        return error
    moved = deviation(before, feedback.pose)
    if moved.exceeds(allowed):
        return ExplainedEvent(
            Event.FAULT_SEEN,
            f"reference moved the robot by {moved} (limits {allowed}); take the guide off the bone and set "
            "`encoders` to 'incremental' if this controller must move for reference",
        )
    if lasted_s > SUPERVISION.reference_timeout_s:
        return ExplainedEvent(
            Event.FAULT_SEEN, f"reference has not ended in {SUPERVISION.reference_timeout_s:g} s; check the controller"
        )
    if feedback.referenced and not feedback.moving:
        return ExplainedEvent(Event.REFERENCE_DONE, "all axes are referenced")
    return None


def distance_from_path(start: PlatformPose, target: PlatformPose, pose: PlatformPose) -> Deviation:
    """How far a pose lies beside the straight move between two poses, at the nearest moment of the move."""
    first, last, here = start.as_array(), target.as_array(), pose.as_array()
    along = last - first
    length_squared = float(along @ along)
    share = float(np.clip((here - first) @ along / length_squared, 0.0, 1.0)) if length_squared > 0.0 else 0.0
    return deviation(PlatformPose.from_array(first + share * along), pose)
