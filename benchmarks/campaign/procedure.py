"""One procedure of the campaign: what people do at the console and with their hands, rightly or wrongly."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from pydantic import ValidationError

from benchmarks.campaign.case_entry import set_up
from benchmarks.campaign.harm import UNHEARD, MotionWatch
from benchmarks.campaign.room import CampaignRoom
from benchmarks.campaign.rows import DrilledHole, Moment, Noticed
from benchmarks.campaign.system import WHO, System
from benchmarks.campaign.troubles import Error, Troubles
from services.ui_api.core.case import Case
from services.ui_api.core.event_data import LocalisationReceived, Step
from services.ui_api.core.procedure_table import Verdict, decide_step
from services.ui_api.handlers.cases import StepRequest
from services.ui_api.handlers.commands import PlainVerb
from services.ui_api.handlers.planning import MotionRequest, PlanBasis
from services.ui_api.handlers.refusals import Refused
from services.ui_api.record.unit_of_work import UnitOfWork
from services.ui_api.routes.invalid_request import wrongs_of
from shared.errors import ReasonCode
from shared.messages.base import decode
from shared.messages.registration import LocalisationRecord, Plan, Verification
from shared.messages.robot import RobotState
from shared.robot_states import MotionState
from simulation.controller.faults import Fault
from simulation.scenario.sampling import scenario_of_seed
from simulation.scenario.values import Scenario

# Chosen, as in `distalock.procedure`: what people try before they go on by hand.
MOST_SHOTS: Final = 4
MOST_MOVES: Final = 3
WORTH_CORRECTING_MM: Final = 0.25
_ANOTHER_VIEW_DEG: Final = (2.0, 1.5)
# Chosen: how often people begin an alignment, or make the robot ready, anew.
_MOST_RETRIES: Final = 6
_TICK_S: Final = 0.1
# Longer than registration's `image_delay_s`: nobody presses the pedal within half a second of a motion.
_PAUSE_S: Final = 0.8
_MOST_MOTION_S: Final = 60.0
# Real time, which only a silent controller costs; a busy machine must not look like one.
REPLY_TIMEOUT_S: Final = 0.5
_TEN_MINUTES_S: Final = 610.0
_AT_REST: Final = (Moment.PREPARE, Moment.IMAGE)
# Codes by which the system names an error, so that people who heed it find it.
_NAMES: Final = {
    Error.WRONG_SIDE: ("laterality_mismatch",),
    Error.WRONG_NAIL: ("nail_model_mismatch", "nail_not_found", "hole_not_visible"),
    Error.WRONG_EXTENSION: ("head_extension", "mount_place"),
    Error.GUIDE_TURNED: ("guide_turned", "nail_model_mismatch", "mount_place"),
    Error.LOOSE_MOUNT: ("images_disagree", "head_extension", "guide_turned", "mount_place"),
}


_VERBS: Final[Mapping[MotionState, PlainVerb | None]] = {
    MotionState.FAULT: "reset",
    MotionState.STOPPED: "acknowledge_stop",
    MotionState.UNREFERENCED: "reference",
    MotionState.LOCKED: None,
}


class GaveUp(Exception):
    """The procedure does not go on; the message says why."""


class Again(Exception):
    """The alignment begins anew: something was mended, or the robot was stopped."""


@dataclass(slots=True)
class Procedure:
    """People who lead one case over the gateway's handlers, in simulated time."""

    scenario: Scenario
    system: System
    room: CampaignRoom
    watch: MotionWatch
    troubles: Troubles
    moment: Moment = Moment.OPEN
    noticed: list[Noticed] = field(default_factory=list)
    holes: list[DrilledHole] = field(default_factory=list)
    moves: int = 0
    stops: int = 0
    slipped: bool = False
    against: bool = False
    pending: set[str] = field(default_factory=set)
    mended: bool = False
    verified: tuple[str, ...] = ()

    # The whole

    def run(self) -> str:
        """Lead the case to its end; why it did not end with drilled holes, or nothing."""
        self.pending = {"error", "fault"}
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
        raise GaveUp(self._last())

    def _last(self) -> str:
        return f"{self.noticed[-1].code}: {self.noticed[-1].sentence}" if self.noticed else "nothing was said"

    def _enter(self, moment: Moment) -> None:
        """The next step begins; what goes wrong before it goes wrong now."""
        self.moment = moment
        troubles = self.troubles
        if "fault" in self.pending and troubles.fault is not None and troubles.fault_at is moment is not Moment.MOVE:
            self.pending.discard("fault")
            self._fault(troubles.fault)
        if "error" not in self.pending or troubles.error_at is not moment:
            return
        match troubles.error:
            case Error.LOOSE_MOUNT:
                self.pending.discard("error")
                self._slip()
            case Error.MOVED_LEG:
                self.pending.discard("error")
                self.room.smear_px = troubles.size
            case Error.OLD_IMAGE if moment in (Moment.PLAN, Moment.MOVE):
                self.pending.discard("error")
                self._wait(_TEN_MINUTES_S, 10.0)
            case _:
                return

    def _slip(self) -> None:
        angle = np.random.default_rng([self.scenario.seed, *b"slip"]).uniform(0.0, 2.0 * np.pi)
        size = self.troubles.size
        self.room.slip((size * float(np.cos(angle)), size * float(np.sin(angle)), 0.0))
        self.slipped = True

    def _fault(self, fault: Fault) -> None:
        """Something fails for a while; what the services make of it is seen afterwards."""
        virtual = self.system.rig.virtual
        virtual.inject(fault)
        self._wait(self.troubles.fault_lasts_s)
        if self.moment in _AT_REST and self._robot.state is not MotionState.LOCKED:
            self.stops += 1
            self._note(self._stop_code(), f"the robot is {self._robot.state}: {self._robot.detail}")
        virtual.clear(fault)
        self._wait(_PAUSE_S)

    # Time

    def _wait(self, seconds: float, step_s: float = _TICK_S) -> None:
        for _ in range(max(1, round(seconds / step_s))):
            self.watch.tick(step_s)
            self.system.settle()

    @contextmanager
    def _asked(self) -> Iterator[UnitOfWork]:
        """One request to the gateway; what it makes the services do is done when it has been answered."""
        self.watch.inside = bool(self.system.record.ledger.inside())
        with self.system.record.write() as unit:
            yield unit
        self.system.settle()
        self.watch.inside = bool(self.system.record.ledger.inside())

    def _note(self, code: str, sentence: str) -> None:
        self.noticed.append(Noticed(self.moment, code, sentence))

    @property
    def _case(self) -> Case:
        return self.system.open_case

    @property
    def _robot(self) -> RobotState:
        return self.system.rig.state

    # Steps

    def _open(self) -> None:
        self.moment = Moment.OPEN
        try:
            body = set_up(self.scenario, self.troubles)
        except ValidationError as error:  # nobody gets further with such an entry: it is read again
            self._note(
                "invalid_request",
                wrongs_of([{**one, "loc": ("body", *one["loc"])} for one in error.errors()])[0].message,
            )
            body, self.mended = set_up(self.scenario, None), True
        with self._asked() as unit:
            self.system.cases.open_case(unit, body.request(), WHO.name)
        self.watch.wrong_side = self.troubles.error is Error.WRONG_SIDE
        self._wait(3 * _TICK_S)

    def _make_ready(self) -> None:
        """Reset, acknowledge, reference, until the robot is locked and free of stops."""
        self._enter(Moment.PREPARE)
        for _ in range(2 * _MOST_RETRIES):
            verb = self._next_verb()
            if verb is None and self._robot.state is MotionState.LOCKED:
                return
            if verb is not None:
                self._plain(verb)
            self._wait(0.6)
        newest = next(reversed(self.system.record.ledger.operations.values()), None)
        detail = (newest.message if newest else "") or self._robot.detail or self._robot.state
        self._note("robot_not_ready", f"the robot does not become ready: {detail}")
        raise GaveUp(self._last())

    def _next_verb(self) -> PlainVerb | None:
        """What a robot at rest needs next; None when it is ready, or does not come to rest."""
        for _ in range(10):
            if self._robot.state in _VERBS:
                break
            self._wait(0.5)
        return _VERBS.get(self._robot.state)

    def _plain(self, verb: PlainVerb) -> None:
        try:
            with self._asked() as unit:
                self.system.commands.begin_plain(unit, verb, WHO)
        except Refused as refusal:
            self._note(refusal.code, str(refusal))

    def _shot(self) -> LocalisationReceived | None:
        self._wait(_PAUSE_S)
        pixels, nominal = self.room.shoot()
        sha256 = self.system.receive(pixels, self.scenario.parts.ring, nominal, self.scenario.side, self.room.angles)
        self.slipped = False  # what moved until now is in this image
        found = self._case.localisation_of(sha256)
        for code in () if found is None or found.verdict == "accepted" else found.reason_codes:
            self._note(code, self._sentence_of(found, code))
        return found

    def _sentence_of(self, found: LocalisationReceived | None, code: str) -> str:
        if found is None:
            return ""
        reasons = self._document(found).localisation.reasons
        return next((reason.message for reason in reasons if reason.code == code), "")

    def _document(self, found: LocalisationReceived) -> LocalisationRecord:
        return decode(LocalisationRecord, self.system.record.document(found.document_sha256))

    def _localise(self) -> LocalisationReceived:
        """Take images until one is accepted; turn the C-arm as advised, take away what lies there."""
        for _ in range(MOST_SHOTS):
            found = self._shot()
            if found is not None and found.verdict == "accepted":
                return found
            self._mend_if_named(() if found is None else found.reason_codes)
            self.room.cluttered = False
            self._turn(found)
        raise GaveUp(self._last())

    def _turn(self, found: LocalisationReceived | None) -> None:
        turn = None if found is None else self._document(found).localisation.c_arm_correction_deg
        if found is not None and turn is not None and ReasonCode.TILT_TOO_LARGE.value in found.reason_codes:
            self.room.turn_c_arm(turn.about_image_x, turn.about_image_y)
        else:
            self.room.turn_c_arm(*_ANOTHER_VIEW_DEG)

    def _groups(self) -> list[tuple[str, ...]]:
        """All holes in one move where their spacings agree, otherwise one hole per move."""
        holes = self._case.hole_ids
        self._enter(Moment.IMAGE)
        for _ in range(_MOST_RETRIES):
            found = self._localise()
            self._enter(Moment.PLAN)
            try:
                planning = self.system.planning
                reply = planning.ask_for_plan(planning.request(self._case, PlanBasis(found.number), holes))
            except Refused as refusal:
                self._note(refusal.code, str(refusal))
                self._mend_if_named((refusal.code,))
                continue
            if reply.code == "unequal_spacing":
                return [(hole,) for hole in holes]
            return [holes]
        raise GaveUp(self._last())

    def _align(self, group: tuple[str, ...]) -> None:
        """Move until what is left is not worth another move, as the verification shows it."""
        self.verified = ()
        for _ in range(MOST_MOVES):
            plan_number = self._plan(group)
            if self.troubles.error is Error.EARLY_DRILL and "error" in self.pending:
                self._drill_early(group, Moment.PLAN)
            self._move(plan_number)
            if self.troubles.error is Error.EARLY_DRILL and "error" in self.pending:
                self._drill_early(group, Moment.VERIFY)
            left = self._verify()
            mine = [one for one in left.guide_holes if one.id in group]
            if all(max(one.entry_offset_mm, one.exit_offset_mm) <= WORTH_CORRECTING_MM for one in mine):
                break
        self.verified = self._case.verifications[-1].passing_hole_ids or ()
        if not set(group) <= set(self.verified):
            self._note("doubtful", f"after {MOST_MOVES} moves a drill would not surely pass")
            raise GaveUp(self._last())

    def _plan(self, group: tuple[str, ...]) -> int:
        """Plan from the newest accepted localisation and have it approved."""
        newest = self._case.newest_localisation()
        stale = newest is None or newest.verdict != "accepted" or newest.case_revision != self._case.revision
        if stale or self._case.staleness_of_image(newest.image_sha256, newest.case_revision) is not None:  # type: ignore[union-attr]
            self._enter(Moment.IMAGE)
            newest = self._localise()
        assert newest is not None
        self._enter(Moment.PLAN)
        try:
            planning = self.system.planning
            reply = planning.ask_for_plan(planning.request(self._case, PlanBasis(newest.number), group))
            case_id = self._case.case_id
            with self._asked() as unit:
                number = self.system.planning.keep_plan(unit, case_id, newest.number, group, reply)
            if number is None:
                self._note(reply.code or "no_plan", reply.message)
                self._mend_if_named((reply.code or "",))
                self._shot()
                raise Again
            with self._asked() as unit:
                self.system.planning.approve(unit, self._case, number, WHO)
        except Refused as refusal:
            self._note(refusal.code, str(refusal))
            self._mend_if_named((refusal.code,))
            raise Again from None
        return number

    def _move(self, plan_number: int) -> None:
        """Have the approved plan carried out, and see how it ends."""
        self._enter(Moment.MOVE)
        if self.troubles.error is Error.WIRE_INSIDE and "error" in self.pending:
            self.pending.discard("error")
            self._step(Step.WIRES_INSERTED, "it is in the way")
        try:
            with self._asked() as unit:
                request = MotionRequest(plan_number, hold_to_move=False, who=WHO.name)
                operation = self.system.planning.begin_motion(unit, self._case, request)
        except Refused as refusal:
            self._note(refusal.code, str(refusal))
            if refusal.code == "wires_in_place":
                self._step(Step.WIRES_REMOVED)
            raise Again from None
        self._follow(operation.requested.operation_id, plan_number)

    def _follow(self, operation_id: str, plan_number: int) -> None:
        rig = self.system.rig
        if rig.sent_moves or self._robot.state is MotionState.MOVING or self._is_accepted(operation_id):
            plan = decode(Plan, self.system.record.document(self._case.plans[plan_number - 1].made.plan_sha256))
            self.watch.permit((plan.start_pose.value(), plan.target_pose.value()))
        self._wait(0.3)
        self._disturb_motion()
        for _ in range(round(_MOST_MOTION_S / _TICK_S)):
            ended = self.system.record.ledger.operations[operation_id]
            if ended.ended:
                break
            self._wait(_TICK_S)
        ended = self.system.record.ledger.operations[operation_id]
        if ended.status != "succeeded":
            at_rest = self._robot.state is MotionState.LOCKED
            self.stops += not at_rest
            code, detail = (ended.code, ended.message) if at_rest else (self._stop_code(), self._robot.detail)
            self._note(code or "failed", f"the motion {ended.status}: {detail or ended.message}")
            self._wait(_PAUSE_S)
            raise Again
        self.moves += 1

    def _is_accepted(self, operation_id: str) -> bool:
        return self.system.record.ledger.operations[operation_id].status in ("running", "succeeded")

    def _stop_code(self) -> str:
        return {MotionState.FAULT: "fault", MotionState.STOPPED: "stopped"}.get(self._robot.state, "failed")

    def _disturb_motion(self) -> None:
        """What happens while the robot moves: a stop, or a fault."""
        if self.troubles.error is Error.STOP_PRESSED and "error" in self.pending:
            self.pending.discard("error")
            self.watch.note_stop()
            self.system.stops.stop("the surgeon wants it")
            self._wait(1.0)
        troubles = self.troubles
        if "fault" in self.pending and troubles.fault is not None and troubles.fault_at is Moment.MOVE:
            self.pending.discard("fault")
            if troubles.fault not in UNHEARD:
                self.watch.note_stop_when_at_rest()
            self._fault(troubles.fault)

    def _verify(self) -> Verification:
        """One more image, and what it leaves between the guide's holes and the nail's."""
        self._enter(Moment.VERIFY)
        self._localise()
        image = self._case.images[-1].image_sha256
        try:
            verifications = self.system.verifications
            reply = verifications.ask(verifications.request(self._case, (image,), "guide"))
            case_id = self._case.case_id
            with self._asked() as unit:
                number = self.system.verifications.keep(unit, case_id, (image,), reply)
        except Refused as refusal:
            self._note(refusal.code, str(refusal))
            raise Again from None
        if number is None or reply.verification is None or reply.verification.verdict != "accepted":
            reasons = () if reply.verification is None else reply.verification.reasons
            code = str(reasons[0].code) if reasons else reply.code or "no_verification"
            self._note(code, reasons[0].message if reasons else reply.message)
            raise Again
        return reply.verification

    def _drill(self, group: tuple[str, ...]) -> None:
        self._enter(Moment.DRILL)
        if self._robot.state is not MotionState.LOCKED:
            self.stops += 1
            self._note(self._stop_code(), f"the robot is {self._robot.state}: {self._robot.detail}")
            raise Again
        for hole_id in group:
            decision = decide_step(self.system.procedure.situation(self._case), Step.DRILLED)
            if decision.verdict is not Verdict.ALLOWED:
                self._note(decision.code, decision.message)
                raise Again
            self._drill_hole(hole_id, allowed=hole_id in self.verified)
            self._step(Step.DRILLED, hole_ids=(hole_id,))

    def _drill_early(self, group: tuple[str, ...], moment: Moment) -> None:
        """Somebody takes the drill before the guide was verified, and may be told."""
        if self.troubles.error_at is not moment:
            return
        self.pending.discard("error")
        decision = decide_step(self.system.procedure.situation(self._case), Step.DRILLED)
        if decision.verdict is Verdict.ALLOWED:
            self._drill_hole(group[0], allowed=True)
            return
        self.moment = Moment.DRILL
        self._note(decision.code, decision.message)
        if not self.troubles.heeds:
            self.against = True
            self._drill_hole(group[0], allowed=False)
            raise GaveUp(f"drilled all the same; {self._last()}")

    def _drill_hole(self, hole_id: str, *, allowed: bool) -> None:
        truth = next(one for one in self.room.errors() if one.id == hole_id)
        passage = self.room.drill(hole_id)
        self.holes.append(
            DrilledHole(hole_id, truth.entry_offset_mm, truth.angle_deg, passage.passed, allowed, self.slipped)
        )

    def _step(self, step: Step, why: str = "", hole_ids: tuple[str, ...] = ()) -> None:
        try:
            with self._asked() as unit:
                holes = hole_ids or self._case.hole_ids
                self.system.cases.record_step(unit, self._case.case_id, StepRequest(step, holes, WHO.name, why))
        except Refused as refusal:
            self._note(refusal.code, str(refusal))

    # Mending

    def _mend_if_named(self, codes: tuple[str, ...]) -> None:
        """People who heed what is said find the error that it names, mend it, and begin anew."""
        error = self.troubles.error
        if self.mended or not self.troubles.heeds or not set(codes) & set(_NAMES.get(error, ())):
            return
        self.mended = True
        if error is Error.LOOSE_MOUNT:
            self._step(Step.MOUNT_MOVED, "the mount was loose and has been tightened")
        elif error is Error.GUIDE_TURNED:
            self._turn_guide_round()
        else:
            with self._asked() as unit:
                self.system.cases.change_setup(
                    unit, self._case.case_id, set_up(self.scenario, None).request(), WHO.name, "it was wrong"
                )
            self.watch.wrong_side = False

    def _turn_guide_round(self) -> None:
        self.scenario = scenario_of_seed(self.scenario.seed)
        self.room.room.scenario = self.room.scenario = self.scenario
        self._step(Step.MOUNT_MOVED, "the guide was the wrong way round")
