"""Everything that decides what may be done next: how far the case is, what it has, and the robot. Pure.

All that decides is an enumeration, so that a test can go through every situation. What only sentences quote is in
`Observed`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from services.ui_api.core.inside import ObjectKind
from services.ui_api.core.procedure import Progress
from shared.robot_states import MotionState, StopButton, StopLatch


class Basis(StrEnum):
    """What a plan can be made from."""

    NOTHING = "nothing"
    STALE = "stale"
    REJECTED = "rejected"
    SEVERAL = "several"
    ACCEPTED = "accepted"


class PlanStanding(StrEnum):
    """What the newest plan is good for."""

    NONE = "none"
    STALE = "stale"
    MADE = "made"
    APPROVED_BEFORE_USERS = "approved_before_users"
    APPROVED = "approved"


class Pending(StrEnum):
    """A command under way that moves the robot."""

    NOTHING = "nothing"
    MOVE = "move"
    REFERENCE = "reference"


class LastStep(StrEnum):
    """Whether the step that was recorded last can be taken back."""

    NONE = "none"
    CANNOT_BE_UNDONE = "cannot_be_undone"
    CAN_BE_UNDONE = "can_be_undone"


class RobotCondition(StrEnum):
    """The robot as last seen, as far as it decides anything."""

    ABSENT = "absent"
    STALE = "stale"
    DISCONNECTED = "disconnected"
    FAULT = "fault"
    BUTTON_PRESSED = "button_pressed"
    STOPPED = "stopped"
    UNREFERENCED = "unreferenced"
    UNDER_WAY = "under_way"
    READY = "ready"


_CONDITION_OF_STATE: Mapping[MotionState, RobotCondition] = {
    MotionState.DISCONNECTED: RobotCondition.DISCONNECTED,
    MotionState.FAULT: RobotCondition.FAULT,
    MotionState.STOPPED: RobotCondition.STOPPED,
    MotionState.UNREFERENCED: RobotCondition.UNREFERENCED,
    MotionState.REFERENCING: RobotCondition.UNDER_WAY,
    MotionState.MOVING: RobotCondition.UNDER_WAY,
    MotionState.LOCKED: RobotCondition.READY,
}


def condition_of(state: MotionState, stop: StopLatch, button: StopButton) -> RobotCondition:
    """The condition of a robot whose state is fresh."""
    condition = _CONDITION_OF_STATE[state]
    if condition in (RobotCondition.DISCONNECTED, RobotCondition.FAULT) or stop is StopLatch.CLEAR:
        return condition
    return RobotCondition.BUTTON_PRESSED if button is StopButton.PRESSED else RobotCondition.STOPPED


@dataclass(frozen=True, slots=True)
class Observed:
    """What sentences quote, by the names that they use. It decides nothing."""

    values: Mapping[str, str] = field(default_factory=dict)

    def fill(self, template: str) -> str:
        """A sentence with its values put in."""
        return template.format_map(_Named(self.values))


class _Named(dict[str, str]):
    """Values by their names; a name without a value stands for itself."""

    def __missing__(self, name: str) -> str:
        return name.replace("_", " ")


@dataclass(frozen=True, slots=True)
class Situation:
    """What decides.

    Attributes
    ----------
    has_images
        Whether there is an image to verify with.
    guide_seen
        False when the newest localisation found no guide, as in the image from before the robot is mounted.
    side_agrees
        False when the newest image states another side of the body than the case.
    hexapod_agrees
        False when the robot was started with another hexapod file than the case has.
    some_drilled, all_screwed
        Whether a hole of the case was drilled, and whether each has a screw.
    """

    progress: Progress = field(default_factory=Progress)
    basis: Basis = Basis.NOTHING
    plan: PlanStanding = PlanStanding.NONE
    pending: Pending = Pending.NOTHING
    robot: RobotCondition = RobotCondition.READY
    has_images: bool = False
    guide_seen: bool = True
    some_drilled: bool = False
    all_screwed: bool = False
    last_step: LastStep = LastStep.NONE
    side_agrees: bool = True
    hexapod_agrees: bool = True
    observed: Observed = field(default_factory=Observed)

    @property
    def kinds_inside(self) -> frozenset[ObjectKind]:
        """What kinds of objects are in the guide or the bone."""
        return frozenset(found.kind for found in self.progress.inside)
