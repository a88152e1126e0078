"""The whole procedure as a console would lead it: REST only, and the hands of the virtual room for the rest."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from distalock.case_client import CaseClient, codes_of, is_accepted, summary_of
from distalock.client import RequestRefused
from distalock.client.models import CArmCorrection, LocalisationView, OperationView, PlanView, VerifiedGuideHole
from distalock.robot_readiness import NotDone
from distalock.room_client import DrillResult, RoomClient, TrueError
from shared.equipment import LEAST_CHANCE_TO_PASS
from shared.errors import ReasonCode
from shared.figures import figure

MOST_SHOTS_FOR_ONE_ANSWER: Final = 4
MOST_MOVES_PER_ALIGNMENT: Final = 3
WORTH_CORRECTING_MM: Final = 0.25
# Refusals that another direction of the beam can heal; after any other the procedure ends as refused.
_TURNABLE: Final = frozenset(
    {
        ReasonCode.RING_NOT_FOUND,
        ReasonCode.RING_AMBIGUOUS,
        ReasonCode.RING_TOO_FEW_BALLS,
        ReasonCode.CALIBRATION_EXTRAPOLATED,
        ReasonCode.GUIDE_NOT_FOUND,
        ReasonCode.GUIDE_AMBIGUOUS,
        ReasonCode.GUIDE_TOO_FEW_BALLS,
        ReasonCode.GUIDE_MODEL_MISMATCH,
        ReasonCode.NAIL_NOT_FOUND,
        ReasonCode.HOLE_NOT_VISIBLE,
        ReasonCode.NAIL_MODEL_MISMATCH,
        ReasonCode.MIRROR_AMBIGUOUS,
        ReasonCode.UNCERTAINTY_TOO_LARGE,
        ReasonCode.TILT_TOO_LARGE,
        ReasonCode.WIRE_NOT_FOUND,
        ReasonCode.IMAGES_DISAGREE,
        ReasonCode.IMAGE_PROCESSED,
    }
)
_ANOTHER_VIEW: Final = CArmCorrection(about_image_x=2.0, about_image_y=1.5)

Tell = Callable[[str], None]


class Ending(StrEnum):
    """How a procedure ended."""

    DRILLED = "drilled"
    REFUSED = "refused"
    MISSED = "missed"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a procedure came to.

    Attributes
    ----------
    why
        The refusal's sentence; empty unless refused.
    before, after
        True errors of the guide holes' axes before the first move, and where each was drilled: the robot may have
        gone on to another hole since. Of a hole that was not drilled, at the end.
    """

    ending: Ending
    why: str
    before: tuple[TrueError, ...]
    after: tuple[TrueError, ...]
    shots: int
    moves: int
    drills: tuple[DrillResult, ...]


class Refused(Exception):
    """The system refused to go on; the message says why."""


@dataclass(slots=True)
class Procedure:
    """One case from the mounted guide to the drilled holes.

    Attributes
    ----------
    tell
        Called with one line of progress for people.
    """

    case: CaseClient
    room: RoomClient
    hole_ids: Sequence[str]
    tell: Tell
    shots: int = 0
    moves: int = 0
    drills: list[DrillResult] = field(default_factory=list)
    drilled_with: dict[str, TrueError] = field(default_factory=dict)

    def run(self) -> Outcome:
        """Prepare, align, verify, drill. A refusal of the system ends the procedure: an outcome, not an error."""
        before = self.room.true_errors()
        try:
            self._prepare()
            for hole_ids in self._holes_that_move_together(self._localise()):
                self._align(hole_ids)
                self._drill(hole_ids)
        except (NotDone, Refused, RequestRefused) as refusal:
            return self._outcome(Ending.REFUSED, str(refusal), before)
        ending = Ending.DRILLED if all(d.passed for d in self.drills) else Ending.MISSED
        return self._outcome(ending, "", before)

    def _outcome(self, ending: Ending, why: str, before: tuple[TrueError, ...]) -> Outcome:
        after = tuple(self.drilled_with.get(e.hole_id, e) for e in self.room.true_errors())
        return Outcome(ending, why, before, after, self.shots, self.moves, tuple(self.drills))

    def _prepare(self) -> None:
        self.case.make_robot_ready()
        self.tell("robot: stop acknowledged, referenced, locked")

    def _holes_that_move_together(self, seen: LocalisationView) -> list[tuple[str, ...]]:
        """All holes in one move when the spacings of guide and nail agree, otherwise one hole per move."""
        try:
            self.case.plan(seen.number, self.hole_ids)
        except RequestRefused as refusal:
            if refusal.problem_code != "unequal_spacing":
                raise
            self.tell(f"one hole per move: {refusal}")
            return [(hole_id,) for hole_id in self.hole_ids]
        return [tuple(self.hole_ids)]

    def _align(self, hole_ids: tuple[str, ...]) -> None:
        """Move until what is left between the axes is not worth another move."""
        seen = self.case.newest_localisation()
        for _ in range(MOST_MOVES_PER_ALIGNMENT):
            self._move(self.case.plan(seen.number, hole_ids))
            seen = self._localise()
            left = self._verified(hole_ids)
            if all(max(e.entry_offset_mm, e.exit_offset_mm) <= WORTH_CORRECTING_MM for e in left):
                break
        doubtful = [e for e in left if e.chance_to_pass < LEAST_CHANCE_TO_PASS]
        if doubtful:
            chance = figure(doubtful[0].chance_to_pass, LEAST_CHANCE_TO_PASS, 3)
            raise Refused(
                f"after {MOST_MOVES_PER_ALIGNMENT} moves a drill through guide hole '{doubtful[0].id}' would pass "
                f"with a chance of {chance} (limit {LEAST_CHANCE_TO_PASS}): {_sentence(left)}"
            )

    def _move(self, plan: PlanView) -> None:
        content = plan.plan
        left = "; ".join(f"{p.id} {p.offset_mm:.2f} mm" for p in content.predicted)
        self.tell(
            f"plan {plan.number}: move {content.travel_mm:.2f} mm, {content.travel_deg:.2f}°; should leave {left}"
        )
        self.case.approve(plan)
        operation = self.case.move(plan)
        _require_success(operation, "the motion")
        self.moves += 1
        read_back = f"{operation.deviation_mm:.3f} mm and {operation.deviation_deg:.3f}° from the target"
        self.tell(f"approved, moved, locked {read_back}")

    def _localise(self) -> LocalisationView:
        """Take shots until one is accepted, turning the C-arm as advised."""
        seen = self._shot()
        for _ in range(MOST_SHOTS_FOR_ONE_ANSWER - 1):
            if is_accepted(seen) or not set(codes_of(seen)) <= _TURNABLE:
                break
            turn = _ANOTHER_VIEW
            if ReasonCode.TILT_TOO_LARGE in codes_of(seen) and seen.c_arm_correction_deg is not None:
                turn = seen.c_arm_correction_deg
            self.tell(f"turning the C-arm by {turn.about_image_x:+.1f}° and {turn.about_image_y:+.1f}°")
            self.room.turn_c_arm(turn.about_image_x, turn.about_image_y)
            seen = self._shot()
        if not is_accepted(seen):
            raise Refused(f"no image was accepted; the last was {summary_of(seen)}")
        return seen

    def _shot(self) -> LocalisationView:
        uid = self.room.take_shot()
        self.shots += 1
        seen = self.case.localisation_of(uid)
        self.tell(f"shot {self.shots} {summary_of(seen)}")
        return seen

    def _verified(self, hole_ids: tuple[str, ...]) -> list[VerifiedGuideHole]:
        """What the newest image leaves between the guide's holes and the nail's."""
        verification = self.case.verify([self.case.newest_image_id()], of="guide")
        left = [e for e in verification.guide_holes if e.id in hole_ids]
        if verification.verdict != "accepted" or len(left) != len(hole_ids):
            raise Refused(
                "the image does not allow a verification: " + "; ".join(r.message for r in verification.reasons)
            )
        self.tell(f"verified: {_sentence(left)}")
        return left

    def _drill(self, hole_ids: tuple[str, ...]) -> None:
        self.drilled_with |= {e.hole_id: e for e in self.room.true_errors() if e.hole_id in hole_ids}
        for hole_id in hole_ids:
            result = self.room.drill(hole_id)
            self.drills.append(result)
            self.case.record_step("drilled", [hole_id])
            verdict = "passed" if result.passed else f"STRUCK {result.struck}"
            self.tell(
                f"drilled {hole_id}: {verdict}, {result.entry_offset_mm:.2f} mm off at entry, "
                f"{result.exit_offset_mm:.2f} mm at exit"
            )


def _require_success(operation: OperationView, what: str) -> None:
    if operation.status != "succeeded":
        raise Refused(f"{what} {operation.status}: {operation.detail}")


def _sentence(errors: Sequence[VerifiedGuideHole]) -> str:
    return "; ".join(
        f"{e.id} {e.entry_offset_mm:.2f} mm at entry, {e.exit_offset_mm:.2f} mm at exit, {e.angle_deg:.2f}°, "
        f"passes with {e.chance_to_pass:.3f}"
        for e in errors
    )
