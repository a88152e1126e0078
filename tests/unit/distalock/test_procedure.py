"""The procedure with a nail whose spacing the guide does not have: each hole is aligned and drilled by itself."""

from collections.abc import Sequence
from typing import Literal, TypeVar

from pydantic import BaseModel

from distalock.case_client import CaseClient
from distalock.client import RequestRefused
from distalock.client.models import (
    LocalisationView,
    OperationView,
    Plan,
    PlanView,
    PredictedHoleError,
    StandardUncertainty,
    VerificationView,
    VerifiedGuideHole,
)
from distalock.procedure import Ending, Procedure
from distalock.room_client import DrillResult, RoomClient, TrueError

M = TypeVar("M", bound=BaseModel)


def some(kind: type[M], **members: object) -> M:
    """Of an answer, what the procedure reads of it."""
    return kind.model_construct(None, **members)


HOLES = ("distal", "proximal")
START_MM, LEFT_MM, OTHER_SPACING_MM = 6.0, 0.1, 2.0
SHOT, IMAGE = "1.2.3", "a" * 64
REACHED = some(OperationView, id="m", status="succeeded", detail="", deviation_mm=0.0, deviation_deg=0.0)
SEEN = some(
    LocalisationView,
    number=1,
    verdict="accepted",
    reasons=(),
    camera=None,
    guide=None,
    holes=None,
    c_arm_correction_deg=None,
)
SMALL = StandardUncertainty(entry_mm=0.1, axis_deg=0.1)


class Room(RoomClient):
    """A guide that a move brings to one hole: then the other one is off by the difference of the spacings."""

    def __init__(self) -> None:
        self.aligned: str | None = None

    def true_errors(self) -> tuple[TrueError, ...]:
        def offset_mm(hole_id: str) -> float:
            return START_MM if self.aligned is None else LEFT_MM if hole_id == self.aligned else OTHER_SPACING_MM

        return tuple(TrueError(hole_id, offset_mm(hole_id), offset_mm(hole_id), 0.1) for hole_id in HOLES)

    def take_shot(self) -> str:
        return SHOT

    def drill(self, hole_id: str) -> DrillResult:
        return DrillResult(hole_id, hole_id == self.aligned, LEFT_MM, LEFT_MM, None)


class Case(CaseClient):
    """Accepts every image and allows one hole per move."""

    def __init__(self, room: Room) -> None:
        self.room = room

    def make_robot_ready(self) -> None:
        pass

    def localisation_of(self, sop_instance_uid: str) -> LocalisationView:
        assert sop_instance_uid == SHOT
        return SEEN

    def newest_localisation(self) -> LocalisationView:
        return SEEN

    def newest_image_id(self) -> str:
        return IMAGE

    def plan(self, localisation: int, hole_ids: Sequence[str]) -> PlanView:
        assert localisation == SEEN.number
        if len(hole_ids) > 1:
            raise RequestRefused.of(409, "unequal_spacing", "plan one hole per move")
        left = PredictedHoleError(
            id=hole_ids[0], offset_mm=0.0, angle_deg=0.0, chance_to_pass=1.0, standard_uncertainty=SMALL
        )
        move = some(Plan, travel_mm=6.0, travel_deg=0.0, predicted=(left,))
        return some(PlanView, number=1, sha256="b" * 64, plan=move)

    def approve(self, plan: PlanView) -> None:
        pass

    def move(self, plan: PlanView) -> OperationView:
        self.room.aligned = plan.plan.predicted[0].id
        return REACHED

    def verify(self, image_ids: Sequence[str], of: Literal["wires", "guide"] = "wires") -> VerificationView:
        assert (image_ids, of) == ([IMAGE], "guide")
        offsets = [
            VerifiedGuideHole(
                id=e.hole_id,
                entry_offset_mm=e.entry_offset_mm,
                exit_offset_mm=e.exit_offset_mm,
                angle_deg=0.1,
                chance_to_pass=1.0,
                standard_uncertainty=SMALL,
            )
            for e in self.room.true_errors()
        ]
        return some(VerificationView, verdict="accepted", reasons=(), guide_holes=tuple(offsets), wires=())

    def record_step(self, step: str, hole_ids: Sequence[str] = (), why: str = "") -> None:
        pass


def test_the_error_of_a_hole_is_that_with_which_it_was_drilled() -> None:
    room = Room()
    outcome = Procedure(Case(room), room, HOLES, lambda _: None).run()
    assert outcome.ending is Ending.DRILLED, outcome.why
    assert [e.entry_offset_mm for e in outcome.before] == [START_MM, START_MM]
    assert [e.entry_offset_mm for e in outcome.after] == [LEFT_MM, LEFT_MM]
    assert outcome.moves == 2
