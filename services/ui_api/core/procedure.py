"""How far a case is, as tables.

Two small machines run side by side. `Stage` is how far the case is; `Aim` is what is known about the next move. Both
are moved by `Trigger`s, which `core.case` reads off the event log; a pair that is not in a table changes nothing.
What may come next says `core.procedure_table`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from services.ui_api.core.inside import Inside, ObjectKind


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
    APPROVAL_WITHDRAWN = "approval_withdrawn"
    MOTION_REQUESTED = "motion_requested"
    MOTION_REACHED = "motion_reached"
    MOTION_CUT_SHORT = "motion_cut_short"
    MOTION_NEVER_BEGAN = "motion_never_began"
    GUIDE_MAY_HAVE_MOVED = "guide_may_have_moved"
    VERIFICATION_ACCEPTED = "verification_accepted"
    VERIFICATION_REJECTED = "verification_rejected"
    ALL_HOLES_DRILLED = "all_holes_drilled"
    ROBOT_REMOVED = "robot_removed"
    FINISHED = "finished"
    ABANDONED = "abandoned"


CLOSED_STAGES = frozenset({Stage.FINISHED, Stage.ABANDONED})

_AT_REST = (Stage.POSITIONING, Stage.ALIGNED, Stage.VERIFIED, Stage.DRILLED, Stage.ROBOT_REMOVED)

# MOVING -> the stage before the move is not remembered: a move that ends anywhere but at its target leaves the guide
# somewhere new, and one that never began is put back by `core.case`.
STAGE_TABLE: Mapping[tuple[Stage, Trigger], Stage] = {
    (Stage.ALIGNED, Trigger.SETUP_CHANGED): Stage.POSITIONING,
    (Stage.VERIFIED, Trigger.SETUP_CHANGED): Stage.POSITIONING,
    (Stage.ALIGNED, Trigger.GUIDE_MAY_HAVE_MOVED): Stage.POSITIONING,
    (Stage.VERIFIED, Trigger.GUIDE_MAY_HAVE_MOVED): Stage.POSITIONING,
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
    # Also from no aim: several localisations, or a verification, may allow what the newest one alone does not.
    **{(a, Trigger.PLAN_MADE): Aim.PLANNED for a in _ANY_AIM},
    (Aim.PLANNED, Trigger.PLAN_APPROVED): Aim.APPROVED,
    (Aim.APPROVED, Trigger.APPROVAL_WITHDRAWN): Aim.PLANNED,
    **{(a, Trigger.MOTION_REACHED): Aim.NONE for a in _ANY_AIM},
    **{(a, Trigger.MOTION_CUT_SHORT): Aim.NONE for a in _ANY_AIM},
    **{(a, Trigger.GUIDE_MAY_HAVE_MOVED): Aim.NONE for a in _ANY_AIM},
    **{(a, Trigger.ROBOT_REMOVED): Aim.NONE for a in _ANY_AIM},
}

# An image shows the present state of things until one of these; None leaves it as it was.
_SEEN_TABLE: Mapping[Trigger, bool] = {
    Trigger.IMAGE_RECEIVED: True,
    Trigger.SETUP_CHANGED: False,
    Trigger.MOTION_REACHED: False,
    Trigger.MOTION_CUT_SHORT: False,
    Trigger.GUIDE_MAY_HAVE_MOVED: False,
    Trigger.VERIFICATION_ACCEPTED: False,
    Trigger.VERIFICATION_REJECTED: False,
    Trigger.ROBOT_REMOVED: False,
}


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a case stands.

    Attributes
    ----------
    inside
        What is in the guide or the bone: while there is anything, the robot must not move.
    seen
        Whether an image has come since the robot moved, the set-up changed, wires went in or out, or the last
        verification.
    """

    stage: Stage = Stage.POSITIONING
    aim: Aim = Aim.NONE
    inside: frozenset[Inside] = frozenset()
    seen: bool = False

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
            _SEEN_TABLE.get(trigger, self.seen),
        )
