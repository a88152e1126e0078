"""The procedure as one table: every action, who may take it, and what must hold for it. Pure.

The view of a case and every handler read this table alone, so that what a case says and what a request is answered are
the same. `docs/procedure.md` is printed from it. The robot service checks every motion again by itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from services.ui_api.core import procedure_conditions as c
from services.ui_api.core import roles
from services.ui_api.core.event_data import Step
from services.ui_api.core.inside import REMOVING_STEPS
from services.ui_api.core.procedure import Stage
from services.ui_api.core.procedure_conditions import Condition, Judge, Sort
from services.ui_api.core.situation import RobotCondition, Situation


class Action(StrEnum):
    """What may come next."""

    TAKE_IMAGE = "take_image"
    REQUEST_PLAN = "request_plan"
    APPROVE_PLAN = "approve_plan"
    WITHDRAW_APPROVAL = "withdraw_approval"
    START_MOTION = "start_motion"
    VERIFY = "verify"
    CHANGE_SETUP = "change_setup"
    RECORD_STEP = "record_step"
    WITHDRAW_STEP = "withdraw_step"
    STOP = "stop"
    ACKNOWLEDGE_STOP = "acknowledge_stop"
    REFERENCE = "reference"
    RESET = "reset"


@dataclass(frozen=True, slots=True)
class Row:
    """An action of the table.

    Attributes
    ----------
    permission
        Row of `core.roles` that says who may.
    request
        How it is asked for.
    conditions
        What must hold; the first that does not is the reason.
    """

    permission: roles.Action
    request: str
    conditions: tuple[Condition, ...]


TABLE: Final[Mapping[Action, Row]] = {
    Action.TAKE_IMAGE: Row(roles.Action.RECORD_STEP, "the C-arm's pedal", (c.OPEN, c.HANDS_OFF)),
    Action.REQUEST_PLAN: Row(
        roles.Action.PLAN,
        "`POST /cases/{id}/plans`",
        (
            c.OPEN,
            *c.NOTHING_INSIDE,
            c.HANDS_OFF,
            c.MOVES_ARE_MADE,
            c.LOCALISED,
            c.LOCALISED_NOW,
            c.LOCALISED_WELL,
            c.SIDE_AGREES,
            c.HEXAPOD_AGREES,
        ),
    ),
    Action.APPROVE_PLAN: Row(
        roles.Action.APPROVE_PLAN,
        "`POST /cases/{id}/plans/{n}/approval`",
        (c.OPEN, c.PLANNED, c.PLAN_HOLDS, c.NOT_APPROVED),
    ),
    Action.WITHDRAW_APPROVAL: Row(
        roles.Action.APPROVE_PLAN,
        "`DELETE /cases/{id}/plans/{n}/approval`",
        (c.OPEN, c.PLANNED, c.PLAN_HOLDS, c.APPROVED),
    ),
    Action.START_MOTION: Row(
        roles.Action.MOVE,
        "`POST /cases/{id}/motions`",
        (
            c.OPEN,
            c.PLANNED,
            c.PLAN_HOLDS,
            c.APPROVED,
            c.APPROVED_BY_A_USER,
            c.HEXAPOD_AGREES,
            *c.NOTHING_INSIDE,
            c.MOVES_ARE_MADE,
            c.NO_OPERATION,
            c.HEARD,
            c.HEARD_NOW,
            c.NO_STOP,
            c.LOCKED,
        ),
    ),
    Action.VERIFY: Row(
        roles.Action.VERIFY,
        "`POST /cases/{id}/verifications`",
        (c.OPEN, c.HANDS_OFF, c.ROBOT_THERE, c.AN_IMAGE),
    ),
    Action.CHANGE_SETUP: Row(roles.Action.CHANGE_SET_UP, "`PATCH /cases/{id}`", (c.OPEN, c.HANDS_OFF)),
    Action.RECORD_STEP: Row(roles.Action.RECORD_STEP, "`POST /cases/{id}/steps`", (c.OPEN, c.HANDS_OFF)),
    Action.WITHDRAW_STEP: Row(
        roles.Action.RECORD_STEP,
        "`DELETE /cases/{id}/steps/{n}`",
        (c.OPEN, c.HANDS_OFF, c.A_STEP, c.STEP_CAN_BE_UNDONE),
    ),
    Action.STOP: Row(roles.Action.STOP, "`POST /robot/stop`", ()),
    Action.ACKNOWLEDGE_STOP: Row(
        roles.Action.PREPARE_ROBOT,
        "`POST /robot/acknowledge-stop`",
        (c.HEARD, c.HEARD_NOW, *c.robot_is(RobotCondition.STOPPED)),
    ),
    Action.REFERENCE: Row(
        roles.Action.PREPARE_ROBOT,
        "`POST /robot/reference`",
        (
            c.NO_OPERATION,
            c.HEARD,
            c.HEARD_NOW,
            *c.NOTHING_INSIDE,
            *c.robot_is(RobotCondition.UNREFERENCED, at_once=(RobotCondition.READY,)),
        ),
    ),
    Action.RESET: Row(
        roles.Action.PREPARE_ROBOT, "`POST /robot/reset`", (c.HEARD, c.HEARD_NOW, *c.robot_is(RobotCondition.FAULT))
    ),
}
ROBOT_ACTIONS: Final = (Action.STOP, Action.ACKNOWLEDGE_STOP, Action.REFERENCE, Action.RESET)

_REMOVED = tuple(REMOVING_STEPS)
_INSERTED = (Step.WIRES_INSERTED, Step.DRILL_INSERTED, Step.DRILLED, Step.SCREWS_INSERTED)
_MOUNTING = (Step.MOUNT_MOVED, Step.RING_REMOUNTED)
# Steps in order, by stage. Each can be repeated: what was drilled is drilled again, a screw is changed.
STEPS_IN_ORDER: Final[Mapping[Stage, tuple[Step, ...]]] = {
    Stage.POSITIONING: (*_MOUNTING, *_REMOVED, Step.ROBOT_REMOVED, Step.ABANDONED),
    Stage.MOVING: (),
    Stage.ALIGNED: (Step.WIRES_INSERTED, *_REMOVED, *_MOUNTING, Step.ROBOT_REMOVED, Step.ABANDONED),
    Stage.VERIFIED: (*_INSERTED, *_REMOVED, *_MOUNTING, Step.ROBOT_REMOVED, Step.ABANDONED),
    Stage.DRILLED: (*_INSERTED, *_REMOVED, Step.ROBOT_REMOVED, Step.ABANDONED),
    Stage.ROBOT_REMOVED: (Step.SCREWS_INSERTED, *_REMOVED, Step.FINISHED, Step.ABANDONED),
    Stage.FINISHED: (),
    Stage.ABANDONED: (),
}


class Verdict(StrEnum):
    """Whether an action may be taken."""

    ALLOWED = "allowed"
    WITH_REASON = "with_reason"
    REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class Decision:
    """Whether an action may be taken now; code, reason and remedy say why not, and are empty where it may.

    Attributes
    ----------
    judge
        Who refuses it: what only the robot refuses is sent to it all the same.
    """

    verdict: Verdict
    code: str = ""
    reason: str = ""
    remedy: str = ""
    sort: Sort = Sort.STATE
    judge: Judge = Judge.GATEWAY

    @property
    def message(self) -> str:
        """One sentence: what was observed, and what to do."""
        return f"{self.reason}; {self.remedy}"


_ALLOWED: Final = Decision(Verdict.ALLOWED)


def decide(situation: Situation, action: Action) -> Decision:
    """Whether an action may be taken now, by the table."""
    for one in TABLE[action].conditions:
        if not one.holds(situation):
            fill = situation.observed.fill
            return Decision(Verdict.REFUSED, one.code, fill(one.observed), fill(one.remedy), one.sort, one.judge)
    return _ALLOWED


def decide_step(situation: Situation, step: Step) -> Decision:
    """Whether a step may be recorded now; out of order only with a reason, because what was done is a fact."""
    possible = decide(situation, Action.RECORD_STEP)
    if possible.verdict is not Verdict.ALLOWED:
        return possible
    in_order = steps_in_order(situation)
    if step in in_order:
        return _ALLOWED
    return Decision(
        Verdict.WITH_REASON,
        "step_out_of_order",
        f"step '{step}' is out of order while the case is '{situation.progress.stage}' (in order: "
        f"{', '.join(in_order)})",
        "if it was done all the same, say why",
    )


def steps_in_order(situation: Situation) -> tuple[Step, ...]:
    """Steps that need no reason now: what is taken out must be inside."""
    if decide(situation, Action.RECORD_STEP).verdict is not Verdict.ALLOWED:
        return ()
    kinds = situation.kinds_inside
    return tuple(
        step
        for step in STEPS_IN_ORDER[situation.progress.stage]
        if step not in REMOVING_STEPS or REMOVING_STEPS[step] in kinds
    )


def allowed_actions(situation: Situation) -> tuple[Action, ...]:
    """What may be done now, in the order in which a console would offer it; nothing in a closed case."""
    if situation.progress.closed:
        return ()
    return tuple(action for action in Action if decide(situation, action).verdict is Verdict.ALLOWED)


def who_may(action: Action) -> tuple[roles.Role, ...]:
    """Roles that may take an action."""
    allowed = roles.PERMISSION_OF[TABLE[action].permission].roles
    return tuple(role for role in roles.Role if role in allowed)
