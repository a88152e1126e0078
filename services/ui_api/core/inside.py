"""What is in the guide and the bone, as far as people have reported it: while there is anything, nothing moves."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from services.ui_api.core.event_data import Step


class ObjectKind(StrEnum):
    """What can be in a hole."""

    WIRE = "wire"
    DRILL = "drill"
    SCREW = "screw"


@dataclass(frozen=True, slots=True, order=True)
class Inside:
    """Something in a hole of the guide or the bone."""

    kind: ObjectKind
    hole_id: str


INSERTING_STEPS: Final[Mapping[Step, ObjectKind]] = {
    Step.WIRES_INSERTED: ObjectKind.WIRE,
    Step.DRILL_INSERTED: ObjectKind.DRILL,
    Step.SCREWS_INSERTED: ObjectKind.SCREW,
}
REMOVING_STEPS: Final[Mapping[Step, ObjectKind]] = {
    Step.WIRES_REMOVED: ObjectKind.WIRE,
    Step.DRILL_REMOVED: ObjectKind.DRILL,
    Step.SCREWS_REMOVED: ObjectKind.SCREW,
}
# A hole is reported as drilled when the drill is out again.
TAKEN_OUT: Final[Mapping[Step, ObjectKind]] = {**REMOVING_STEPS, Step.DRILLED: ObjectKind.DRILL}


def inside_after(inside: frozenset[Inside], step: Step, hole_ids: frozenset[str]) -> frozenset[Inside]:
    """What is inside after a step at some holes."""
    if step in INSERTING_STEPS:
        return inside | {Inside(INSERTING_STEPS[step], hole_id) for hole_id in hole_ids}
    if step in TAKEN_OUT:
        return inside - {Inside(TAKEN_OUT[step], hole_id) for hole_id in hole_ids}
    return inside


def removing_step_of(kind: ObjectKind) -> Step:
    """The step that reports a kind of object as removed."""
    return next(step for step, removed in REMOVING_STEPS.items() if removed is kind)
