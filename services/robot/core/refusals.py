"""Why the robot refuses a command: one table of stable codes with what is checked, the limit, and the remedy. Pure.

`docs/refusals.md` is printed from `CRITERIA`. Limits that an installation may change are settings of the robot service
(`services/robot/settings.py`); the table gives their defaults.
"""

from dataclasses import dataclass

from services.robot.core.refusal_codes import RefusalCode as RefusalCode
from services.robot.core.tuning import PERMITS, PLAN_TOLERANCES, SUPERVISION


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
_COMPARE_KEYS = "see who else sends commands; compare the keys (distalock pki show) and start the installation again"
_PERMIT_AGAIN = "ask the gateway again: it makes a permit for each command"


def _criteria() -> tuple[RefusalCriterion, ...]:
    return (
        *_criteria_of_commands(),
        *_criteria_of_permits(),
        *_criteria_of_the_guard_on_supervision_and_plan(),
        *_criteria_of_the_guard_on_the_robot(),
        *_criteria_of_the_guard_on_the_path(),
    )


def _criteria_of_commands() -> tuple[RefusalCriterion, ...]:
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
        row(
            code.STOPPED_SINCE,
            "state that the command quotes",
            "published after the last stop",
            "see why the robot was stopped, then ask again",
        ),
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
    )


def _criteria_of_permits() -> tuple[RefusalCriterion, ...]:
    code, row = RefusalCode, RefusalCriterion
    return (
        row(code.PERMIT_MISSING, "permit of a move or a reference", "present", "ask through the gateway (REST)"),
        row(code.PERMIT_ALTERED, "hash of the permit's text", "the one that came with it", _COMPARE_KEYS),
        row(code.PERMIT_OF_ANOTHER_KEY, "key that the permit names", "the gateway's permit key", _COMPARE_KEYS),
        row(code.PERMIT_FORGED, "signature of the permit", "the gateway's, over this very text", _COMPARE_KEYS),
        row(code.PERMIT_UNREADABLE, "signed permit", "format version 1", "run gateway and robot in the same version"),
        row(code.PERMIT_FOR_ANOTHER_MOTION, "motion that the permit allows", "what is asked for", _PERMIT_AGAIN),
        row(code.PERMIT_OF_ANOTHER_BOOT, "run of the robot service in the permit", "this run", _PERMIT_AGAIN),
        row(
            code.PERMIT_FOR_ANOTHER_HEXAPOD,
            "hexapod of the permit, by its hash",
            "the one this service was started with",
            "give case and robot service the same hexapod file",
        ),
        row(code.PERMIT_OF_ANOTHER_CASE, "case of the permit", "the open case", _PERMIT_AGAIN),
        row(code.PERMIT_OF_ANOTHER_REVISION, "revision of the case in the permit", "the newest", _PLAN_AGAIN),
        row(code.PERMIT_FOR_ANOTHER_PLAN, "plan that the permit allows", "the plan that is asked for", _PERMIT_AGAIN),
        row(code.PERMIT_FOR_OTHER_HOLES, "holes of the permit", "those of the plan", "plan and approve again"),
        row(code.PERMIT_STATE_UNKNOWN, "robot state that the permit quotes", "published", _PERMIT_AGAIN),
        row(
            code.PERMIT_EXPIRED,
            "age of the robot state that the permit quotes",
            f"{PERMITS.lifetime_s:g} s on the robot's clock",
            _PERMIT_AGAIN,
        ),
        row(code.PERMIT_BEFORE_STOP, "state that the permit quotes", "published after the last stop", _PERMIT_AGAIN),
        row(code.PERMIT_USED, "permit", "not used before", _PERMIT_AGAIN),
        row(
            code.PERMIT_WITHOUT_CLEARANCE,
            "what the permit says of guide and bone",
            "nothing is inside",
            "take out what is inside and record it",
        ),
        row(
            code.SOMETHING_INSIDE,
            "wires, drills and screws in guide and bone, as the case says",
            "none",
            "take them out and record it",
        ),
    )


def _criteria_of_the_guard_on_supervision_and_plan() -> tuple[RefusalCriterion, ...]:
    code, row = RefusalCode, RefusalCriterion
    return (
        # The guard: supervision
        row(code.LINK_LOST, "link to the router", "present", "wait until the network is back: nothing moves before"),
        row(
            code.HEARTBEAT_MISSING,
            "silence of the gateway",
            "0.2 s (`heartbeat_deadline_s`)",
            "see that it runs and ask again",
        ),
        row(
            code.GUARDIAN_MISSING,
            "guardian process, which stops the robot when the robot service cannot",
            "started and answering",
            "wait a second and ask again; if it stays so, restart the robot service",
        ),
        row(
            code.REGISTRATION_SILENT,
            "silence of registration",
            "1 s (`registration_deadline_s`)",
            "see that it runs and ask again",
        ),
        # The guard: age of the plan
        row(code.PLAN_UNKNOWN, "plan", "published by registration since this service started", "make a new plan"),
        row(code.PLAN_ALREADY_EXECUTED, "plan", "not begun before", _PLAN_AGAIN),
        row(code.PLAN_STALE, "registration epoch of the plan", "the newest", "plan from the newest image"),
        row(code.PLAN_EXPIRED, "age of the plan", "600 s (`plan_lifetime_s`)", _PLAN_AGAIN),
        row(code.PLAN_BEFORE_RECONNECTION, "time of the plan", "after the controller was connected", _PLAN_AGAIN),
        row(code.PLAN_OF_ANOTHER_CASE, "case and revision of the plan", "those of the open case", _PLAN_AGAIN),
    )


def _criteria_of_the_guard_on_the_robot() -> tuple[RefusalCriterion, ...]:
    code, row = RefusalCode, RefusalCriterion
    return (
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
    )


def _criteria_of_the_guard_on_the_path() -> tuple[RefusalCriterion, ...]:
    code, row = RefusalCode, RefusalCriterion
    return (
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
