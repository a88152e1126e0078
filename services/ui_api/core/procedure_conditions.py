"""The conditions of the procedure: what must hold for an action, and what is said where it does not. Pure data.

A condition gives its reason code, what is observed and the remedy: the same for the view of a case and for the answer
to a request. Values in braces are those of `situation.Observed`.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

from services.ui_api.core.inside import ObjectKind, removing_step_of
from services.ui_api.core.procedure import Stage
from services.ui_api.core.situation import Basis, LastStep, Pending, PlanStanding, RobotCondition, Situation


class Sort(StrEnum):
    """What sort of obstacle it is."""

    STATE = "state"
    MISSING = "missing"
    SILENCE = "silence"


class Judge(StrEnum):
    """Who refuses: the gateway at once, or the robot, whose newest state may be later than what was seen here."""

    GATEWAY = "gateway"
    ROBOT = "robot"


@dataclass(frozen=True, slots=True)
class Condition:
    """One thing that must hold.

    Attributes
    ----------
    needs
        What must hold, for the printed table.
    observed, remedy
        What is said where it does not.
    """

    needs: str
    holds: Callable[[Situation], bool]
    code: str
    observed: str
    remedy: str
    sort: Sort = Sort.STATE
    judge: Judge = Judge.GATEWAY


OPEN: Final = Condition(
    "the case is open",
    lambda s: not s.progress.closed,
    "case_closed",
    "case {case} is {stage}: nothing more is done in it",
    "open another case",
)
HANDS_OFF: Final = Condition(
    "nothing moves",
    lambda s: s.progress.stage is not Stage.MOVING and s.pending is Pending.NOTHING,
    "robot_moving",
    "the robot is moving ({operation})",
    "wait until it has ended, or stop it",
)
NO_OPERATION: Final = Condition(
    "no move or reference is under way",
    lambda s: s.pending is Pending.NOTHING,
    "operation_pending",
    "{operation}",
    "wait until it has ended, or stop it",
)


def _nothing_of(kind: ObjectKind, code: str) -> Condition:
    return Condition(
        f"no {kind} is in the guide or the bone",
        lambda s: kind not in s.kinds_inside,
        code,
        f"{kind}s are in {{{kind}_holes}}: the robot does not move before they are removed",
        f"take them out and record the step '{removing_step_of(kind)}'",
    )


IN_PLACE_CODES: Final = {
    ObjectKind.WIRE: "wires_in_place",
    ObjectKind.DRILL: "drill_in_place",
    ObjectKind.SCREW: "screws_in_place",
}
NOTHING_INSIDE: Final = tuple(_nothing_of(kind, code) for kind, code in IN_PLACE_CODES.items())
_STAGES_FOR_MOVES: Final = (Stage.POSITIONING, Stage.ALIGNED, Stage.VERIFIED)
MOVES_ARE_MADE: Final = Condition(
    "the case is 'positioning', 'aligned' or 'verified'",
    lambda s: s.progress.stage in _STAGES_FOR_MOVES,
    "not_now",
    "the case is '{stage}': no move is planned or made now",
    "go on with the next step, or abandon the case",
)
ROBOT_THERE: Final = Condition(
    "the robot was not taken off",
    lambda s: s.progress.stage is not Stage.ROBOT_REMOVED,
    "not_now",
    "the case is '{stage}': the guide is no longer there",
    "insert the screws and finish the case",
)
AN_IMAGE: Final = Condition(
    "the case has an image",
    lambda s: s.has_images,
    "image_not_found",
    "the case has no image",
    "take one",
    Sort.MISSING,
)
LOCALISED: Final = Condition(
    "there is a localisation",
    lambda s: s.basis is not Basis.NOTHING,
    "localisation_not_found",
    "the case has no localisation",
    "take an image with ring, guide and both nail holes in view, and wait for its localisation",
    Sort.MISSING,
)
LOCALISED_NOW: Final = Condition(
    "the newest localisation is of the newest image and the present set-up",
    lambda s: s.basis is not Basis.STALE,
    "localisation_stale",
    "localisation {localisation} is stale: {localisation_stale_because}",
    "wait for the localisation of the newest image, or take one",
)
LOCALISED_WELL: Final = Condition(
    "it was accepted, or there are others, or a verification, to plan from together with it",
    lambda s: s.basis is not Basis.REJECTED,
    "localisation_rejected",
    "localisation {localisation} was rejected ({reasons})",
    "take one more image",
)
SIDE_AGREES: Final = Condition(
    "the images' headers state no other side than the case",
    lambda s: s.side_agrees,
    "laterality_mismatch",
    "the case is of the {side} side, and the newest image's header states the {image_side} side",
    "see which side it is; correct the case, or the patient's data at the C-arm, and take one more image",
)
HEXAPOD_AGREES: Final = Condition(
    "the robot was started with the case's hexapod file",
    lambda s: s.hexapod_agrees,
    "hexapod_mismatch",
    "the case has hexapod '{hexapod}' with hash {case_hexapod}, the robot was started with one with hash "
    "{robot_hexapod}",
    "give both the same file: change the case, or start the robot service with its file (DISTALOCK_ROBOT_HEXAPOD_FILE)",
)
PLANNED: Final = Condition(
    "there is a plan",
    lambda s: s.plan is not PlanStanding.NONE,
    "plan_not_found",
    "the case has no plan",
    "request one from the newest localisation",
    Sort.MISSING,
)
PLAN_HOLDS: Final = Condition(
    "the newest plan holds",
    lambda s: s.plan is not PlanStanding.STALE,
    "plan_stale",
    "plan {plan} is stale: {plan_stale_because}",
    "request a new plan",
)
NOT_APPROVED: Final = Condition(
    "it is not approved yet",
    lambda s: s.plan not in (PlanStanding.APPROVED, PlanStanding.APPROVED_BEFORE_USERS),
    "plan_already_approved",
    "plan {plan} was approved by {approver}",
    "start the motion, or request a new plan",
)
APPROVED: Final = Condition(
    "a surgeon has approved it",
    lambda s: s.plan is not PlanStanding.MADE,
    "plan_not_approved",
    "plan {plan} is not approved",
    "a surgeon checks it and approves it",
)
APPROVED_BY_A_USER: Final = Condition(
    "the surgeon showed who he is",
    lambda s: s.plan is not PlanStanding.APPROVED_BEFORE_USERS,
    "plan_not_approved",
    "plan {plan} was approved before there were users",
    "request a new plan and approve it",
)
A_STEP: Final = Condition(
    "a step is recorded",
    lambda s: s.last_step is not LastStep.NONE,
    "step_not_found",
    "the case has no step that was recorded and not withdrawn",
    "GET /cases/{case}/steps lists them",
    Sort.MISSING,
)
STEP_CAN_BE_UNDONE: Final = Condition(
    "nothing but images has come since, and it changed no set-up",
    lambda s: s.last_step is not LastStep.CANNOT_BE_UNDONE,
    "step_not_undoable",
    "step {step} ({step_name}) has had consequences: the set-up changed, or the case went on",
    "record what was really done, with a reason",
)
HEARD: Final = Condition(
    "the robot has reported its state",
    lambda s: s.robot is not RobotCondition.ABSENT,
    "robot_absent",
    "the robot service has not reported its state",
    "start it",
    Sort.SILENCE,
)
HEARD_NOW: Final = Condition(
    "its newest state is fresh",
    lambda s: s.robot is not RobotCondition.STALE,
    "robot_state_stale",
    "the robot's newest state is {robot_age} old (limit {robot_age_limit})",
    "check its service and the link",
    Sort.SILENCE,
)
NO_STOP: Final = Condition(
    "no stop is in force",
    lambda s: s.robot not in (RobotCondition.STOPPED, RobotCondition.BUTTON_PRESSED),
    "stop_in_force",
    "the stop is latched",
    "acknowledge it first (POST /robot/acknowledge-stop)",
)
LOCKED: Final = Condition(
    "the robot is referenced and locked",
    lambda s: s.robot is RobotCondition.READY,
    "robot_not_ready",
    "the robot is '{robot_state}', a motion starts from 'locked'",
    "reference it (POST /robot/reference); in a fault see to its cause and reset it; see GET /robot",
)


def _said_by_robot(condition: RobotCondition, code: str, observed: str, remedy: str) -> Condition:
    needs = f"the robot is not '{condition}'"
    return Condition(needs, lambda s: s.robot is not condition, code, observed, remedy, judge=Judge.ROBOT)


# With the robot's own codes; a test compares them with its motion table.
ROBOT_SAYS: Final = {
    RobotCondition.DISCONNECTED: _said_by_robot(
        RobotCondition.DISCONNECTED, "not_connected", "the controller is not connected", "check its power and cable"
    ),
    RobotCondition.FAULT: _said_by_robot(
        RobotCondition.FAULT, "in_fault", "the robot is in fault", "see to its cause, then reset (POST /robot/reset)"
    ),
    RobotCondition.BUTTON_PRESSED: _said_by_robot(
        RobotCondition.BUTTON_PRESSED,
        "stop_button_pressed",
        "the controller's stop button is pressed",
        "find out why, release it, then acknowledge the stop",
    ),
    RobotCondition.STOPPED: _said_by_robot(
        RobotCondition.STOPPED,
        "stop_in_force",
        "a stop is in force",
        "find out why, then acknowledge it (POST /robot/acknowledge-stop)",
    ),
    RobotCondition.UNREFERENCED: _said_by_robot(
        RobotCondition.UNREFERENCED, "not_referenced", "the axes are not referenced", "reference them first"
    ),
    RobotCondition.UNDER_WAY: _said_by_robot(
        RobotCondition.UNDER_WAY, "busy", "a motion is under way", "wait until it ends, or stop it"
    ),
    RobotCondition.READY: _said_by_robot(
        RobotCondition.READY, "nothing_to_do", "the robot is locked, referenced and free of faults", "nothing is needed"
    ),
}


def robot_is(wanted: RobotCondition, *, at_once: Collection[RobotCondition] = ()) -> tuple[Condition, ...]:
    """Conditions of a command that the robot carries out in one condition alone.

    Parameters
    ----------
    at_once
        Conditions in which the gateway refuses it by itself: a newer state would change nothing about that.
    """
    return tuple(
        replace(row, judge=Judge.GATEWAY) if condition in at_once else row
        for condition, row in ROBOT_SAYS.items()
        if condition is not wanted
    )
