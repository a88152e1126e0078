"""Why the robot refuses a command: one table of stable codes with what is checked, the limit, and the remedy. Pure.

`docs/refusals.md` is printed from `CRITERIA`. Limits that an installation may change are settings of the robot service
(`services/robot/settings.py`); the table gives their defaults.
"""

from dataclasses import dataclass
from enum import StrEnum

from services.robot.core.tuning import PLAN_TOLERANCES, SUPERVISION


class RefusalCode(StrEnum):
    """Stable names of refusals: consoles, records and tests rely on them."""

    # The command itself (at most once, never late)
    MESSAGE_INVALID = "message_invalid"
    WRONG_BOOT_EPOCH = "wrong_boot_epoch"
    COMMAND_EXPIRED = "command_expired"
    STATE_NOT_PUBLISHED = "state_not_published"
    COMMAND_OUT_OF_ORDER = "command_out_of_order"
    COMMAND_ID_REUSED = "command_id_reused"
    OUTCOME_UNKNOWN = "outcome_unknown"

    # The motion table
    NOT_CONNECTED = "not_connected"
    STOP_IN_FORCE = "stop_in_force"
    STOP_BUTTON_PRESSED = "stop_button_pressed"
    NOT_REFERENCED = "not_referenced"
    BUSY = "busy"
    IN_FAULT = "in_fault"
    NOTHING_TO_DO = "nothing_to_do"

    # The guard
    LINK_LOST = "link_lost"
    HEARTBEAT_MISSING = "heartbeat_missing"
    POSE_UNKNOWN = "pose_unknown"
    NOT_LOCKED = "not_locked"
    APPROVAL_MISMATCH = "approval_mismatch"
    PLAN_UNKNOWN = "plan_unknown"
    REGISTRATION_SILENT = "registration_silent"
    PLAN_STALE = "plan_stale"
    PLAN_EXPIRED = "plan_expired"
    PLAN_BEFORE_RECONNECTION = "plan_before_reconnection"
    PLAN_ALREADY_EXECUTED = "plan_already_executed"
    PLAN_OF_ANOTHER_CASE = "plan_of_another_case"
    PLAN_FOR_ANOTHER_ROBOT = "plan_for_another_robot"
    PIVOT_MISMATCH = "pivot_mismatch"
    START_POSE_DIFFERS = "start_pose_differs"
    TARGET_INCONSISTENT = "target_inconsistent"
    LEG_LENGTHS_INCONSISTENT = "leg_lengths_inconsistent"
    HEAD_EXTENSION = "head_extension"
    STEP_TOO_LARGE = "step_too_large"
    OUT_OF_REACH = "out_of_reach"


@dataclass(frozen=True, slots=True)
class Refusal:
    """A refusal that was to be expected.

    Attributes
    ----------
    message
        One sentence: what was observed, the limit, what to do.
    """

    code: RefusalCode
    message: str


@dataclass(frozen=True, slots=True)
class RefusalCriterion:
    """One reason for which the robot refuses a command.

    Attributes
    ----------
    checked
        What is checked or measured.
    limit
        What is acceptable.
    remedy
        What to do, as an imperative clause; empty where there is nothing to do.
    """

    code: RefusalCode
    checked: str
    limit: str
    remedy: str


_ASK_AGAIN = "read the robot's present state and ask again"
_PLAN_AGAIN = "take an image and plan again"
_COMPARE = "compare the hexapod files and versions of the services"


def _criteria() -> tuple[RefusalCriterion, ...]:
    code, row = RefusalCode, RefusalCriterion
    return (
        # The command itself
        row(code.MESSAGE_INVALID, "the command's message", "its published schema", "send what the schema describes"),
        row(
            code.WRONG_BOOT_EPOCH,
            "run of the robot service that the command or the plan is for",
            "this run",
            _ASK_AGAIN,
        ),
        row(
            code.COMMAND_EXPIRED,
            "age of the newest state that the client had seen",
            "its time to live, 2 s at most",
            _ASK_AGAIN,
        ),
        row(code.STATE_NOT_PUBLISHED, "state that the command quotes", "published", "subscribe to its state first"),
        row(code.COMMAND_OUT_OF_ORDER, "number of the client's command", "larger than its last", _ASK_AGAIN),
        row(
            code.COMMAND_ID_REUSED,
            "identifier of the command",
            "not used for another command",
            "give every command its own id",
        ),
        row(code.OUTCOME_UNKNOWN, "repeated command", "decided on", "read the robot's state for its outcome"),
        # The motion table
        row(code.NOT_CONNECTED, "connection to the controller", "present", "check its power and cable"),
        row(code.STOP_IN_FORCE, "stop", "acknowledged", "find out why it was pressed and acknowledge it first"),
        row(
            code.STOP_BUTTON_PRESSED,
            "the controller's stop button",
            "not pressed",
            "find out why, release it, then acknowledge the stop",
        ),
        row(code.NOT_REFERENCED, "reference of the axes", "complete", "ask for reference first"),
        row(code.BUSY, "motion under way", "none", "wait until it ends or stop it"),
        row(code.IN_FAULT, "fault", "none", "see to the cause it states, then reset"),
        row(code.NOTHING_TO_DO, "what the command would change", "something", ""),
        # The guard: supervision
        row(code.LINK_LOST, "link to the router", "present", "wait until the network is back: nothing moves before"),
        row(
            code.HEARTBEAT_MISSING,
            "silence of the gateway",
            "0.2 s (`heartbeat_deadline_s`)",
            "see that it runs and ask again",
        ),
        row(
            code.REGISTRATION_SILENT,
            "silence of registration",
            "1 s (`registration_deadline_s`)",
            "see that it runs and ask again",
        ),
        # The guard: approval and age of the plan
        row(
            code.APPROVAL_MISMATCH,
            "plan that was approved",
            "the plan that is asked for",
            "approve the plan that is to be carried out",
        ),
        row(code.PLAN_UNKNOWN, "plan", "published by registration since this service started", "make a new plan"),
        row(code.PLAN_ALREADY_EXECUTED, "plan", "not begun before", _PLAN_AGAIN),
        row(code.PLAN_STALE, "registration epoch of the plan", "the newest", "plan from the newest image"),
        row(code.PLAN_EXPIRED, "age of the plan", "600 s (`plan_lifetime_s`)", _PLAN_AGAIN),
        row(code.PLAN_BEFORE_RECONNECTION, "time of the plan", "after the controller was connected", _PLAN_AGAIN),
        row(code.PLAN_OF_ANOTHER_CASE, "case and revision of the plan", "those of the open case", _PLAN_AGAIN),
        # The guard: the robot itself
        row(
            code.PLAN_FOR_ANOTHER_ROBOT,
            "hexapod file of the plan",
            "this robot's",
            "give registration the file of this robot",
        ),
        row(
            code.PIVOT_MISMATCH,
            "distance of the plan's pivot from the hexapod file's",
            f"{PLAN_TOLERANCES.pivot_mm:g} mm",
            "plan with the pivot of the hexapod file",
        ),
        row(
            code.HEAD_EXTENSION,
            "head extension of the plan",
            "the range of the hexapod file",
            "read its scale again and correct the case",
        ),
        row(
            code.POSE_UNKNOWN,
            "time since the controller reported the pose",
            f"{SUPERVISION.oldest_feedback_s:g} s",
            "check its cable, and ask again in a second",
        ),
        row(
            code.NOT_LOCKED,
            "brakes and servos",
            "locked at rest",
            "wait a second and ask again; if it stays so, stop the robot and check its brakes",
        ),
        row(
            code.START_POSE_DIFFERS,
            "distance of the robot from the plan's start",
            f"{SUPERVISION.read_back}",
            _PLAN_AGAIN,
        ),
        row(
            code.TARGET_INCONSISTENT,
            "distance of the plan's target from where its guide correction leads",
            f"{PLAN_TOLERANCES.target}",
            _COMPARE,
        ),
        row(
            code.LEG_LENGTHS_INCONSISTENT,
            "difference of the plan's leg lengths from this robot's",
            f"{PLAN_TOLERANCES.leg_length_mm:g} mm",
            _COMPARE,
        ),
        row(
            code.STEP_TOO_LARGE,
            "length of the move",
            "20 mm and 12° (`largest_step_mm`, `largest_step_deg`)",
            "bring the guide nearer by hand",
        ),
        row(
            code.OUT_OF_REACH,
            "every pose on the way",
            "within the limits of legs and joints, clear of leg against leg and of singularities",
            "move the mount, or plan one hole at a time",
        ),
    )


CRITERIA = {criterion.code: criterion for criterion in _criteria()}


def refusal(code: RefusalCode, observation: str, remedy: str | None = None) -> Refusal:
    """The refusal of an observation: "<observation>; <remedy>", the table's remedy unless another fits better."""
    remedy = CRITERIA[code].remedy if remedy is None else remedy
    return Refusal(code, f"{observation}; {remedy}" if remedy else observation)
