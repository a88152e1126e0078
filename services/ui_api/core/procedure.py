"""The procedure as tables: how far a case is, and what may come next.

Two small machines run side by side. `Stage` is how far the case is; `Aim` is what is known about the next move. Both
are moved by `Trigger`s, which `core.case` reads off the event log; a pair that is not in a table changes nothing.
`allowed_actions` and `allowed_steps` say what may come next. These are the gateway's rules for people; the robot
service checks every motion again by itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from services.ui_api.core.event_data import Step
from services.ui_api.core.inside import REMOVING_STEPS, Inside, ObjectKind


class Stage(StrEnum):
    """How far a case is."""

    POSITIONING = "positioning"
    MOVING = "moving"
    ALIGNED = "aligned"
    VERIFIED = "verified"
    DRILLED = "drilled"
    ROBOT_REMOVED = "robot_removed"
    FINISHED = "finished"
    ABANDONED = "abandoned"


class Aim(StrEnum):
    """What is known about the next move."""

    NONE = "none"
    LOCALISED = "localised"
    PLANNED = "planned"
    APPROVED = "approved"


class Trigger(StrEnum):
    """What an event means to the procedure."""

    SETUP_CHANGED = "setup_changed"
    IMAGE_RECEIVED = "image_received"
    LOCALISATION_ACCEPTED = "localisation_accepted"
    LOCALISATION_REJECTED = "localisation_rejected"
    PLAN_MADE = "plan_made"
    PLAN_APPROVED = "plan_approved"
    MOTION_REQUESTED = "motion_requested"
    MOTION_REACHED = "motion_reached"
    MOTION_CUT_SHORT = "motion_cut_short"
    MOTION_NEVER_BEGAN = "motion_never_began"
    VERIFICATION_ACCEPTED = "verification_accepted"
    VERIFICATION_REJECTED = "verification_rejected"
    ALL_HOLES_DRILLED = "all_holes_drilled"
    ROBOT_REMOVED = "robot_removed"
    FINISHED = "finished"
    ABANDONED = "abandoned"


class Action(StrEnum):
    """What may come next."""

    TAKE_IMAGE = "take_image"
    REQUEST_PLAN = "request_plan"
    APPROVE_PLAN = "approve_plan"
    START_MOTION = "start_motion"
    STOP = "stop"
    VERIFY = "verify"
    CHANGE_SETUP = "change_setup"
    RECORD_STEP = "record_step"


CLOSED_STAGES = frozenset({Stage.FINISHED, Stage.ABANDONED})

_AT_REST = (Stage.POSITIONING, Stage.ALIGNED, Stage.VERIFIED, Stage.DRILLED, Stage.ROBOT_REMOVED)

# MOVING -> the stage before the move is not remembered: a move that ends anywhere but at its target leaves the guide
# somewhere new, and one that never began is put back by `core.case`.
STAGE_TABLE: Mapping[tuple[Stage, Trigger], Stage] = {
    (Stage.ALIGNED, Trigger.SETUP_CHANGED): Stage.POSITIONING,
    (Stage.VERIFIED, Trigger.SETUP_CHANGED): Stage.POSITIONING,
    **{(s, Trigger.MOTION_REQUESTED): Stage.MOVING for s in (Stage.POSITIONING, Stage.ALIGNED, Stage.VERIFIED)},
    (Stage.MOVING, Trigger.MOTION_REACHED): Stage.ALIGNED,
    (Stage.MOVING, Trigger.MOTION_CUT_SHORT): Stage.POSITIONING,
    (Stage.POSITIONING, Trigger.VERIFICATION_ACCEPTED): Stage.VERIFIED,
    (Stage.ALIGNED, Trigger.VERIFICATION_ACCEPTED): Stage.VERIFIED,
    (Stage.VERIFIED, Trigger.VERIFICATION_REJECTED): Stage.ALIGNED,
    **{(s, Trigger.ALL_HOLES_DRILLED): Stage.DRILLED for s in (Stage.POSITIONING, Stage.ALIGNED, Stage.VERIFIED)},
    **{(s, Trigger.ROBOT_REMOVED): Stage.ROBOT_REMOVED for s in _AT_REST},
    **{(s, Trigger.FINISHED): Stage.FINISHED for s in _AT_REST},
    **{(s, Trigger.ABANDONED): Stage.ABANDONED for s in _AT_REST},
}

_ANY_AIM = tuple(Aim)

AIM_TABLE: Mapping[tuple[Aim, Trigger], Aim] = {
    **{(a, Trigger.SETUP_CHANGED): Aim.NONE for a in _ANY_AIM},
    **{(a, Trigger.IMAGE_RECEIVED): Aim.NONE for a in _ANY_AIM},
    **{(a, Trigger.LOCALISATION_REJECTED): Aim.NONE for a in _ANY_AIM},
    **{(a, Trigger.LOCALISATION_ACCEPTED): Aim.LOCALISED for a in _ANY_AIM},
    (Aim.LOCALISED, Trigger.PLAN_MADE): Aim.PLANNED,
    (Aim.PLANNED, Trigger.PLAN_MADE): Aim.PLANNED,
    (Aim.APPROVED, Trigger.PLAN_MADE): Aim.PLANNED,
    (Aim.PLANNED, Trigger.PLAN_APPROVED): Aim.APPROVED,
    **{(a, Trigger.MOTION_REACHED): Aim.NONE for a in _ANY_AIM},
    **{(a, Trigger.MOTION_CUT_SHORT): Aim.NONE for a in _ANY_AIM},
    **{(a, Trigger.ROBOT_REMOVED): Aim.NONE for a in _ANY_AIM},
}

_REMOVED = tuple(REMOVING_STEPS)

_STEPS_OF_STAGE: Mapping[Stage, tuple[Step, ...]] = {
    Stage.POSITIONING: (Step.MOUNT_MOVED, Step.RING_REMOUNTED, *_REMOVED, Step.ABANDONED),
    Stage.MOVING: (),
    Stage.ALIGNED: (
        Step.WIRES_INSERTED,
        *_REMOVED,
        Step.MOUNT_MOVED,
        Step.RING_REMOUNTED,
        Step.ABANDONED,
    ),
    Stage.VERIFIED: (
        Step.WIRES_INSERTED,
        *_REMOVED,
        Step.DRILL_INSERTED,
        Step.DRILLED,
        Step.SCREWS_INSERTED,
        Step.MOUNT_MOVED,
        Step.RING_REMOUNTED,
        Step.ABANDONED,
    ),
    Stage.DRILLED: (*_REMOVED, Step.SCREWS_INSERTED, Step.ROBOT_REMOVED, Step.ABANDONED),
    Stage.ROBOT_REMOVED: (*_REMOVED, Step.SCREWS_INSERTED, Step.FINISHED, Step.ABANDONED),
    Stage.FINISHED: (),
    Stage.ABANDONED: (),
}

_NEXT_SENTENCE: Mapping[Stage, str] = {
    Stage.POSITIONING: "Take one image with ring, guide and both nail holes in view.",
    Stage.MOVING: "Wait until the robot has reached its target and is locked, or stop it.",
    Stage.ALIGNED: "Insert the wires through the guide, take an image and verify.",
    Stage.VERIFIED: "Drill through the guide.",
    Stage.DRILLED: "Take the robot off.",
    Stage.ROBOT_REMOVED: "Insert the screws and finish the case.",
    Stage.FINISHED: "The case is finished.",
    Stage.ABANDONED: "The case was abandoned.",
}

_NEXT_SENTENCE_OF_AIM: Mapping[Aim, str] = {
    Aim.LOCALISED: "Request a plan from the newest localisation.",
    Aim.PLANNED: "A surgeon approves the plan, quoting its hash.",
    Aim.APPROVED: "Start the motion.",
}


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a case stands.

    Attributes
    ----------
    inside
        What is in the guide or the bone: while there is anything, the robot must not move.
    """

    stage: Stage = Stage.POSITIONING
    aim: Aim = Aim.NONE
    inside: frozenset[Inside] = frozenset()

    @property
    def wired_hole_ids(self) -> frozenset[str]:
        """Holes with a wire through the guide into the nail."""
        return frozenset(found.hole_id for found in self.inside if found.kind is ObjectKind.WIRE)

    @property
    def closed(self) -> bool:
        """Whether the case is over."""
        return self.stage in CLOSED_STAGES

    def after(self, trigger: Trigger) -> "Progress":
        """Where the case stands after a trigger."""
        return Progress(
            STAGE_TABLE.get((self.stage, trigger), self.stage),
            AIM_TABLE.get((self.aim, trigger), self.aim),
            self.inside,
        )


def allowed_actions(progress: Progress) -> tuple[Action, ...]:
    """What may come next, in the order in which a console would offer it."""
    stage, aim = progress.stage, progress.aim
    if progress.closed:
        return ()
    if stage is Stage.MOVING:
        return (Action.STOP,)
    actions = []
    if stage in (Stage.POSITIONING, Stage.ALIGNED, Stage.VERIFIED):
        if aim is not Aim.NONE and not progress.inside:
            actions.append(Action.REQUEST_PLAN)
            actions += [Action.APPROVE_PLAN] if aim is Aim.PLANNED else []
            actions += [Action.START_MOTION] if aim is Aim.APPROVED else []
        actions += [Action.TAKE_IMAGE, Action.VERIFY, Action.CHANGE_SETUP]
    return (*actions, Action.RECORD_STEP, Action.STOP)


def allowed_steps(progress: Progress) -> tuple[Step, ...]:
    """Steps that are in order now; others can be recorded only with a reason, and none while the robot moves."""
    kinds = {found.kind for found in progress.inside}
    return tuple(s for s in _STEPS_OF_STAGE[progress.stage] if s not in REMOVING_STEPS or REMOVING_STEPS[s] in kinds)


def may_be_recorded_with_a_reason(progress: Progress) -> bool:
    """Whether a step out of order can be recorded at all: people's hands are a fact, but not in a closed case."""
    return not progress.closed and progress.stage is not Stage.MOVING


def next_sentence(progress: Progress) -> str:
    """What to do next, for people."""
    moves_next = progress.stage is Stage.POSITIONING and not progress.inside
    if moves_next and progress.aim in _NEXT_SENTENCE_OF_AIM:
        return _NEXT_SENTENCE_OF_AIM[progress.aim]
    if progress.stage is Stage.POSITIONING and progress.inside:
        kinds = " and ".join(f"{kind}s" for kind in sorted({found.kind for found in progress.inside}))
        return f"Remove the {kinds}: the robot does not move while anything is in the guide or the bone."
    return _NEXT_SENTENCE[progress.stage]
