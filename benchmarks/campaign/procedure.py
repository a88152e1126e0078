"""One procedure of the campaign: what people do at the console and with their hands, rightly or wrongly."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from benchmarks.campaign.c_arm import CArmOperator
from benchmarks.campaign.case_entry import opened_with
from benchmarks.campaign.people import PAUSE_S, TICK_S, GaveUp, People
from benchmarks.campaign.rows import Moment
from benchmarks.campaign.system import WHO
from benchmarks.campaign.troubles import Error
from services.ui_api.core.event_data import Step, VerificationRefused
from services.ui_api.core.procedure_table import Verdict, decide_step
from services.ui_api.handlers.commands import PlainVerb
from services.ui_api.handlers.planning import MotionRequest, PlanBasis
from services.ui_api.handlers.refusals import Refused
from shared.messages.base import decode
from shared.messages.registration import Plan, Verification
from shared.robot_states import MotionState

# Chosen, as in `distalock.procedure`: what people try before they go on by hand.
MOST_MOVES: Final = 3
WORTH_CORRECTING_MM: Final = 0.25
# Chosen: how often people begin an alignment, or make the robot ready, anew.
_MOST_RETRIES: Final = 6
_MOST_MOTION_S: Final = 60.0
_VERBS: Final[Mapping[MotionState, PlainVerb | None]] = {
    MotionState.FAULT: "reset",
    MotionState.STOPPED: "acknowledge_stop",
    MotionState.UNREFERENCED: "reference",
    MotionState.LOCKED: None,
}


class Again(Exception):
    """The alignment begins anew: something was mended, or the robot was stopped."""


@dataclass(slots=True)
class Procedure:
    """One case, led over the gateway's handlers from its opening to the drilled holes.

    Attributes
    ----------
    against
        Somebody drilled although the system said that it is not time.
    verified
        Holes that may be drilled as the guide stands.
    """

    people: People
    c_arm: CArmOperator
    moves: int = 0
    against: bool = False
    verified: tuple[str, ...] = ()

    def run(self) -> str:
        """Lead the case to its end; why it did not end with drilled holes, or nothing."""
        try:
            self._open()
            self._make_ready()
            for group in self._groups():
                self._align_and_drill(group)
        except GaveUp as end:
            return str(end)
        return ""

    def _align_and_drill(self, group: tuple[str, ...]) -> None:
        for _ in range(_MOST_RETRIES + 1):
            try:
                self._align(group)
                self._drill(group)
            except Again:
                self._make_ready()
                continue
            return
        raise GaveUp(self.people.last())

    def _open(self) -> None:
        self.people.moment = Moment.OPEN
        body, refused = opened_with(self.people.scenario, self.people.troubles)
        if refused:
            self.people.note("invalid_request", refused)
            self.people.mended = True
        with self.people.asked() as unit:
            self.people.system.cases.open_case(unit, body.request(), WHO.name)
        self.people.watch.wrong_side = self.people.troubles.error is Error.WRONG_SIDE
        self.people.wait(3 * TICK_S)

    def _make_ready(self) -> None:
        """Reset, acknowledge, reference, until the robot is locked and free of stops."""
        self.people.enter(Moment.PREPARE)
        operations = self.people.system.record.ledger.operations
        before = len(operations)
        for _ in range(2 * _MOST_RETRIES):
            verb = self._next_verb()
            if verb is None and self.people.robot.state is MotionState.LOCKED:
                return
            if verb is not None:
                self._plain(verb)
            self.people.wait(0.6)
        asked = list(operations.values())[before:]
        detail = (asked[-1].message if asked else "") or self.people.robot.detail or self.people.robot.state
        self.people.note("robot_not_ready", f"the robot does not become ready: {detail}")
        raise GaveUp(self.people.last())

    def _next_verb(self) -> PlainVerb | None:
        """What a robot at rest needs next; None when it is ready, or does not come to rest."""
        for _ in range(10):
            if self.people.robot.state in _VERBS:
                break
            self.people.wait(0.5)
        return _VERBS.get(self.people.robot.state)

    def _plain(self, verb: PlainVerb) -> None:
        try:
            with self.people.asked() as unit:
                self.people.system.commands.begin_plain(unit, verb, WHO, self.people.system.commands.asked())
        except Refused as refusal:
            self.people.note(refusal.code, str(refusal))

    def _groups(self) -> list[tuple[str, ...]]:
        """All holes in one move where their spacings agree, otherwise one hole per move."""
        holes = self.people.case.hole_ids
        self.people.enter(Moment.IMAGE)
        for _ in range(_MOST_RETRIES):
            found = self.c_arm.localise()
            self.people.enter(Moment.PLAN)
            try:
                planning = self.people.system.planning
                reply = planning.ask_for_plan(planning.request(self.people.case, PlanBasis(found.number), holes))
            except Refused as refusal:
                self.people.note(refusal.code, str(refusal))
                self.people.mend_if_named((refusal.code,))
                continue
            if reply.code == "unequal_spacing":
                return [(hole,) for hole in holes]
            return [holes]
        raise GaveUp(self.people.last())

    def _align(self, group: tuple[str, ...]) -> None:
        """Move until what is left is not worth another move, as the verification shows it."""
        self.verified = ()
        for _ in range(MOST_MOVES):
            plan_number = self._plan(group)
            if self.people.troubles.error is Error.EARLY_DRILL and "error" in self.people.pending:
                self._drill_early(group, Moment.PLAN)
            self._move(plan_number)
            if self.people.troubles.error is Error.EARLY_DRILL and "error" in self.people.pending:
                self._drill_early(group, Moment.VERIFY)
            left = self._verify()
            mine = [one for one in left.guide_holes if one.id in group]
            if all(max(one.entry_offset_mm, one.exit_offset_mm) <= WORTH_CORRECTING_MM for one in mine):
                break
        self.verified = self.people.case.verifications[-1].passing_hole_ids or ()
        if not set(group) <= set(self.verified):
            self.people.note("doubtful", f"after {MOST_MOVES} moves a drill would not surely pass")
            raise GaveUp(self.people.last())

    def _plan(self, group: tuple[str, ...]) -> int:
        """Plan from the newest accepted localisation and have it approved."""
        newest = self.people.case.newest_localisation()
        stale = newest is None or newest.verdict != "accepted" or newest.case_revision != self.people.case.revision
        if stale or self.people.case.staleness_of_image(newest.image_sha256, newest.case_revision) is not None:  # type: ignore[union-attr]
            self.people.enter(Moment.IMAGE)
            newest = self.c_arm.localise()
        assert newest is not None
        self.people.enter(Moment.PLAN)
        try:
            planning = self.people.system.planning
            reply = planning.ask_for_plan(planning.request(self.people.case, PlanBasis(newest.number), group))
            case_id = self.people.case.case_id
            with self.people.asked() as unit:
                number = self.people.system.planning.keep_plan(unit, case_id, newest.number, group, reply)
            if number is None:
                self.people.note(reply.code or "no_plan", reply.message)
                self.people.mend_if_named((reply.code or "",))
                self.c_arm.shot()
                raise Again
            with self.people.asked() as unit:
                self.people.system.planning.approve(unit, self.people.case, number, WHO)
        except Refused as refusal:
            self.people.note(refusal.code, str(refusal))
            self.people.mend_if_named((refusal.code,))
            raise Again from None
        return number

    def _move(self, plan_number: int) -> None:
        """Have the approved plan carried out, and see how it ends."""
        self.people.enter(Moment.MOVE)
        if self.people.troubles.error is Error.WIRE_INSIDE and "error" in self.people.pending:
            self.people.pending.discard("error")
            self.people.step(Step.WIRES_INSERTED, "it is in the way")
        try:
            with self.people.asked() as unit:
                request = MotionRequest(plan_number, hold_to_move=False, who=WHO.name)
                operation = self.people.system.planning.begin_motion(
                    unit, self.people.case, request, self.people.system.commands.asked()
                )
        except Refused as refusal:
            self.people.note(refusal.code, str(refusal))
            if refusal.code == "wires_in_place":
                self.people.step(Step.WIRES_REMOVED)
            raise Again from None
        self._follow(operation.requested.operation_id, plan_number)

    def _follow(self, operation_id: str, plan_number: int) -> None:
        rig = self.people.system.rig
        if rig.sent_moves or self.people.robot.state is MotionState.MOVING or self._is_accepted(operation_id):
            plan = decode(
                Plan, self.people.system.record.document(self.people.case.plans[plan_number - 1].made.plan_sha256)
            )
            self.people.watch.permit((plan.start_pose.value(), plan.target_pose.value()))
        self.people.wait(0.3)
        self.people.disturb_motion()
        for _ in range(round(_MOST_MOTION_S / TICK_S)):
            ended = self.people.system.record.ledger.operations[operation_id]
            if ended.ended:
                break
            self.people.wait(TICK_S)
        ended = self.people.system.record.ledger.operations[operation_id]
        if ended.status != "succeeded":
            at_rest = self.people.robot.state is MotionState.LOCKED
            self.people.stops += not at_rest
            code, detail = (
                (ended.code, ended.message) if at_rest else (self.people.stop_code(), self.people.robot.detail)
            )
            self.people.note(code or "failed", f"the motion {ended.status}: {detail or ended.message}")
            self.people.wait(PAUSE_S)
            raise Again
        self.moves += 1

    def _is_accepted(self, operation_id: str) -> bool:
        return self.people.system.record.ledger.operations[operation_id].status in ("running", "succeeded")

    def _verify(self) -> Verification:
        """One more image, and what it leaves between the guide's holes and the nail's."""
        self.people.enter(Moment.VERIFY)
        self.c_arm.localise()
        image = self.people.case.images[-1].image_sha256
        try:
            verifications = self.people.system.verifications
            reply = verifications.ask(verifications.request(self.people.case, (image,), "guide"))
            case_id = self.people.case.case_id
            with self.people.asked() as unit:
                kept = self.people.system.verifications.keep(unit, case_id, (image,), reply)
        except Refused as refusal:
            self.people.note(refusal.code, str(refusal))
            raise Again from None
        if isinstance(kept, VerificationRefused):
            self.people.note(kept.code, kept.message)
            raise Again
        made = reply.verification
        assert made is not None  # it was kept
        if made.verdict != "accepted":
            self.people.note(str(made.reasons[0].code), made.reasons[0].message)
            raise Again
        return made

    def _drill(self, group: tuple[str, ...]) -> None:
        self.people.enter(Moment.DRILL)
        if self.people.robot.state is not MotionState.LOCKED:
            self.people.stops += 1
            self.people.note(
                self.people.stop_code(), f"the robot is {self.people.robot.state}: {self.people.robot.detail}"
            )
            raise Again
        for hole_id in group:
            decision = decide_step(self.people.system.procedure.situation(self.people.case), Step.DRILLED)
            if decision.verdict is not Verdict.ALLOWED:
                self.people.note(decision.code, decision.message)
                raise Again
            self.people.drill_hole(hole_id, allowed=hole_id in self.verified)
            self.people.step(Step.DRILLED, hole_ids=(hole_id,))

    def _drill_early(self, group: tuple[str, ...], moment: Moment) -> None:
        """Somebody takes the drill before the guide was verified, and may be told."""
        if self.people.troubles.error_at is not moment:
            return
        self.people.pending.discard("error")
        decision = decide_step(self.people.system.procedure.situation(self.people.case), Step.DRILLED)
        if decision.verdict is Verdict.ALLOWED:
            self.people.drill_hole(group[0], allowed=True)
            return
        self.people.moment = Moment.DRILL
        self.people.note(decision.code, decision.message)
        if not self.people.troubles.heeds:
            self.against = True
            self.people.drill_hole(group[0], allowed=False)
            raise GaveUp(f"drilled all the same; {self.people.last()}")
