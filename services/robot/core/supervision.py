"""What a feedback of the controller means: which event of the motion table it is, if any."""

from dataclasses import dataclass

import numpy as np

from services.robot.core.controller_feedback import READ_BACK_TOLERANCE, ControllerFeedback, Deviation, deviation
from services.robot.core.guard import PermittedMove
from services.robot.core.motion import Event, MotionState
from services.robot.core.stop_button import STOP_BUTTON, STOP_BUTTON_RELEASED
from shared.geometry.hexapod import PlatformPose

STOPPED_BY_COMMAND = 10
STOP_CODES = (STOPPED_BY_COMMAND, STOP_BUTTON, STOP_BUTTON_RELEASED)
PATH_TOLERANCE = Deviation(0.5, 0.5)
SETTLE_S = 1.0
REFERENCE_TIMEOUT_S = 60.0

ERROR_SENTENCES = {
    1: "the controller did not understand a command (syntax); the line may be disturbed, check cable and shielding",
    2: "the controller does not know a command; check that it is a GCS 2.0 hexapod controller",
    5: "an axis is not referenced or its servo is off; reset and reference again",
    7: "a target is outside the controller's limits; compare its limits with the hexapod file",
    8: "a velocity is outside the controller's limits; compare its limits with the hexapod file",
    9: "the pivot cannot be changed while the platform is turned; drive it to U V W = 0 with the maker's program",
    STOPPED_BY_COMMAND: "the controller was stopped by a command",
    STOP_BUTTON: "the controller's stop button is pressed; find out why, release it, then acknowledge the stop",
    STOP_BUTTON_RELEASED: "the controller's stop button was pressed and is released; find out why, then acknowledge "
    "the stop",
    216: "a leg has met its limit switch; drive it free with the maker's program, reset and reference again",
    -1024: "a leg does not follow (motion error): something holds the robot; free it, reset and reference again",
}


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
        Own monotonic clock: begin, and since when the controller has said that nothing moves (None while it moves).
    """

    permitted: PermittedMove
    began_s: float
    at_rest_s: float | None = None

    @property
    def longest_s(self) -> float:
        """How long it may take: half as long again as planned, and three seconds to start and settle."""
        return 1.5 * self.permitted.duration_s + 3.0


def error_sentence(code: int) -> str:
    """An error code of the controller as a sentence."""
    return ERROR_SENTENCES.get(code, f"the controller reports error {code}; see its manual, then reset")


def check_at_rest(state: MotionState, feedback: ControllerFeedback) -> ExplainedEvent | None:
    """Check a robot that is to stand still and locked (`locked`, `unreferenced`, `stopped`)."""
    if feedback.moving:
        return ExplainedEvent(Event.FAULT_SEEN, f"the robot moves in the state '{state.value}'; keep clear of it")
    if feedback.error_code in STOP_CODES and state is not MotionState.STOPPED:
        return ExplainedEvent(Event.CONTROLLER_STOPPED, f"not by this service: {error_sentence(feedback.error_code)}")
    if feedback.error_code not in (0, *STOP_CODES):
        return ExplainedEvent(Event.FAULT_SEEN, error_sentence(feedback.error_code))
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
    if not off.exceeds(READ_BACK_TOLERANCE):
        return None
    return ExplainedEvent(
        Event.FAULT_SEEN,
        f"the locked robot has moved by {off} (limits {READ_BACK_TOLERANCE}): a brake slips or an encoder is wrong; "
        "do not drill, check the brakes, then reset and take an image again",
    )


def check_moving(move: MoveUnderWay, feedback: ControllerFeedback, now_s: float) -> ExplainedEvent | None:
    """Check a robot that is carrying out a move; None means go on."""
    if feedback.error_code in STOP_CODES:
        return ExplainedEvent(Event.CONTROLLER_STOPPED, f"not by this service: {error_sentence(feedback.error_code)}")
    if feedback.error_code:
        return ExplainedEvent(Event.FAULT_SEEN, error_sentence(feedback.error_code))
    if not (feedback.unlocked and feedback.referenced):
        return ExplainedEvent(
            Event.FAULT_SEEN, "a servo, a brake or the reference was lost during the move; reset the robot"
        )
    aside = distance_from_path(move.permitted.start, move.permitted.target, feedback.pose)
    if aside.exceeds(PATH_TOLERANCE):
        return ExplainedEvent(
            Event.FAULT_SEEN, f"the robot was {aside} beside its path (limits {PATH_TOLERANCE}); check its legs"
        )
    if feedback.moving or not feedback.on_target:
        return _overdue(move, feedback, now_s)
    off = deviation(move.permitted.target, feedback.pose)
    if off.exceeds(READ_BACK_TOLERANCE):
        return ExplainedEvent(
            Event.FAULT_SEEN, f"the move ended {off} from its target (limits {READ_BACK_TOLERANCE}); check the legs"
        )
    return ExplainedEvent(Event.ARRIVED, f"on the target within {off}")


def _overdue(move: MoveUnderWay, feedback: ControllerFeedback, now_s: float) -> ExplainedEvent | None:
    lasted_s = now_s - move.began_s
    if lasted_s > move.longest_s:
        return ExplainedEvent(
            Event.FAULT_SEEN,
            f"the move has taken {lasted_s:.1f} s (limit {move.longest_s:.1f} s); something holds the robot",
        )
    if move.at_rest_s is not None and now_s - move.at_rest_s > SETTLE_S:
        off = deviation(move.permitted.target, feedback.pose)
        return ExplainedEvent(
            Event.FAULT_SEEN,
            f"the robot came to rest {off} from its target and does not call it reached; something holds it",
        )
    return None


def check_referencing(
    before: PlatformPose, feedback: ControllerFeedback, lasted_s: float, allowed: Deviation
) -> ExplainedEvent | None:
    """Check a robot that is being referenced; it may move by `allowed` (nothing, with absolute encoders)."""
    if feedback.error_code in STOP_CODES:
        return ExplainedEvent(Event.CONTROLLER_STOPPED, f"not by this service: {error_sentence(feedback.error_code)}")
    if feedback.error_code:
        return ExplainedEvent(Event.FAULT_SEEN, error_sentence(feedback.error_code))
    moved = deviation(before, feedback.pose)
    if moved.exceeds(allowed):
        return ExplainedEvent(
            Event.FAULT_SEEN,
            f"reference moved the robot by {moved} (limits {allowed}); take the guide off the bone and set "
            "`encoders` to 'incremental' if this controller must move for reference",
        )
    if lasted_s > REFERENCE_TIMEOUT_S:
        return ExplainedEvent(
            Event.FAULT_SEEN, f"reference has not ended in {REFERENCE_TIMEOUT_S:g} s; check the controller"
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
