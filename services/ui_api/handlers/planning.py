"""Plans, their approval, and the motions made from them."""

from dataclasses import dataclass

from services.ui_api.core.case import Case, PlanEntry
from services.ui_api.core.event_data import LocalisationReceived, PlanApproved, PlanMade, PlanRefused
from services.ui_api.core.events import EventDraft
from services.ui_api.core.identity import Approver, Authenticated
from services.ui_api.core.operations import Operation
from services.ui_api.core.procedure import Stage
from services.ui_api.handlers.cases import require_known_holes
from services.ui_api.handlers.commands import CommandHandler
from services.ui_api.handlers.operation_requests import Move
from services.ui_api.handlers.permits import ApprovedPlan, require_nothing_inside
from services.ui_api.handlers.refusals import RefusalKind, Refused, conflict, unknown
from services.ui_api.handlers.robot_view import RobotView
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import UnitOfWork
from shared.bus.keys import Keys
from shared.bus.port import Bus
from shared.messages.base import decode, encode
from shared.messages.registration import Plan, PlanReply, PlanRequest
from shared.messages.robot import MotionState, StopLatch

# Chosen: a plan may wait for the image that is being localised, which takes seconds on a busy machine.
PLAN_TIMEOUT_S = 10.0
_STAGES_FOR_MOVES = frozenset({Stage.POSITIONING, Stage.ALIGNED, Stage.VERIFIED})


@dataclass(frozen=True, slots=True)
class MotionRequest:
    """A motion that a client asks for."""

    plan_number: int
    hold_to_move: bool
    who: str


@dataclass(frozen=True, slots=True)
class PlanBasis:
    """What a plan is to rest on.

    Attributes
    ----------
    localisation
        The newest, by its number.
    others
        Localisations of the same set-up to fuse with it; it may be among them.
    verification
        The last verification, whose residual is to be corrected; None to bring the guide's own holes onto the nail's.
    """

    localisation: int
    others: tuple[int, ...] = ()
    verification: int | None = None

    @property
    def earlier(self) -> tuple[int, ...]:
        """The others, in order, without the newest."""
        return tuple(sorted(set(self.others) - {self.localisation}))


class PlanningHandler:
    """From an accepted localisation to a motion, one checked step after another."""

    def __init__(self, bus: Bus, keys: Keys, record: CaseRecord, view: RobotView, commands: CommandHandler) -> None:
        self._bus, self._keys, self._record = bus, keys, record
        self._view, self._commands = view, commands

    def ask_for_plan(self, case: Case, basis: PlanBasis, hole_ids: tuple[str, ...]) -> PlanReply:
        """Have registration plan from a localisation; raises `Refused` or `NoReply`. Moves and records nothing."""
        _require_ready_for_moves(case)
        require_known_holes(case, hole_ids)
        alone = not basis.earlier and basis.verification is None
        measured = (_usable_localisation if alone else _newest)(case, basis.localisation)
        request = PlanRequest(
            case_id=case.case_id,
            image_sha256=measured.image_sha256,
            hole_ids=hole_ids,
            earlier_image_sha256=tuple(localisation_of(case, number).image_sha256 for number in basis.earlier),
            verified_image_sha256=() if basis.verification is None else _verified_images(case, basis.verification),
        )
        answer = self._bus.query(self._keys.plan_request, encode(request), PLAN_TIMEOUT_S)
        reply = decode(PlanReply, answer.payload)
        if reply.plan is not None:
            _require_answers(reply.plan, request)
        return reply

    def keep_plan(
        self, unit: UnitOfWork, case_id: str, localisation: int, hole_ids: tuple[str, ...], reply: PlanReply
    ) -> int | None:
        """Record registration's answer; the new plan's number, or None when there is no plan."""
        plan = reply.plan
        if plan is None:
            refusal = PlanRefused(localisation, hole_ids, reply.code or "no_plan", reply.message)
            unit.append(EventDraft(refusal, case_id, "registration"))
            return None
        number = len(self._record.ledger.cases[case_id].plans) + 1
        sha256 = unit.put_document(encode(plan))
        made = PlanMade(number, localisation, hole_ids, sha256, plan.image_sha256, plan.case_revision)
        unit.append(EventDraft(made, case_id, "registration"))
        return number

    def plan_content(self, entry: PlanEntry) -> Plan:
        """A plan as registration made it."""
        return decode(Plan, self._record.document(entry.made.plan_sha256))

    def approve(self, unit: UnitOfWork, case: Case, number: int, approver: Approver) -> PlanApproved:
        """Record a surgeon's consent; the caller has compared the hash that was quoted. Raises `Refused`."""
        entry = plan_of(case, number)
        _require_open(case)
        self._require_current(case, entry)
        if entry.approval is not None:
            raise conflict("plan_already_approved", f"plan {number} was approved by {entry.approval.approved_by}")
        approved = PlanApproved(
            number, entry.made.plan_sha256, approver.name, unit.now_ns, approver.authenticated.value
        )
        unit.append(EventDraft(approved, case.case_id, approver.name))
        return approved

    def begin_motion(self, unit: UnitOfWork, case: Case, request: MotionRequest) -> Operation:
        """Record and send the motion of an approved plan; raises `Refused`."""
        entry = plan_of(case, request.plan_number)
        _require_open(case)
        approval = entry.approval
        if approval is None:
            raise conflict(
                "plan_not_approved", f"plan {request.plan_number} is not approved; a surgeon approves it by its hash"
            )
        approver = _approver(approval)
        self._require_current(case, entry)
        _require_ready_for_moves(case)
        self._require_robot_ready(entry)
        move = Move(
            plan_number=request.plan_number,
            plan=ApprovedPlan(approval.plan_sha256, self.plan_content(entry).hole_ids, approver),
            hold_to_move=request.hold_to_move,
        )
        return self._commands.begin_move(unit, case.case_id, request.who, move)

    def staleness_of(self, case: Case, entry: PlanEntry, plan: Plan) -> str | None:
        """Why a plan no longer holds, as a clause; None when it does hold."""
        if entry.used:
            return "a motion was made from it"
        made_after = case.plans[entry.made.number :]
        if made_after:
            return f"plan {made_after[-1].made.number} was made after it"
        seen = self._view.newest()
        if seen is not None and seen.state.boot_epoch != plan.robot_boot_epoch:
            return "the robot service restarted since"
        return case.staleness_of_image(entry.made.image_sha256, entry.made.case_revision)

    def _require_current(self, case: Case, entry: PlanEntry) -> None:
        clause = self.staleness_of(case, entry, self.plan_content(entry))
        if clause is not None:
            raise conflict("plan_stale", f"plan {entry.made.number} is stale: {clause}; request a new plan")

    def _require_robot_ready(self, entry: PlanEntry) -> None:
        """An early, readable refusal; the robot checks all of this again by itself."""
        state = self._view.current()
        if state.stop is StopLatch.LATCHED:
            raise conflict("stop_in_force", "the stop is latched; acknowledge it first (POST /robot/acknowledge-stop)")
        if state.state is not MotionState.LOCKED:
            raise conflict(
                "robot_not_ready",
                f"the robot is '{state.state}', plan {entry.made.number} starts from 'locked'; see GET /robot",
            )


def _approver(approval: PlanApproved) -> Approver:
    """Who approved; raises `Refused` when nobody had to show who he is, as in older versions."""
    if approval.authenticated_by is None:
        raise conflict(
            "plan_not_approved",
            f"plan {approval.number} was approved before there were users; request a new plan and approve it",
        )
    return Approver(approval.approved_by, Authenticated(approval.authenticated_by))


def plan_of(case: Case, number: int) -> PlanEntry:
    """A plan of a case; raises `Refused`."""
    entry = case.plan(number)
    if entry is None:
        raise unknown("plan", str(number), f"case {case.case_id} has {len(case.plans)}")
    return entry


def localisation_of(case: Case, number: int) -> LocalisationReceived:
    """A localisation of a case; raises `Refused`."""
    if not 1 <= number <= len(case.localisations):
        raise unknown("localisation", str(number), f"case {case.case_id} has {len(case.localisations)}")
    return case.localisations[number - 1]


def localisation_staleness(case: Case, measured: LocalisationReceived) -> str | None:
    """Why a localisation no longer holds, as a clause; None when it does hold."""
    newest = case.newest_localisation()
    if newest is not None and newest.number != measured.number:
        return f"localisation {newest.number} is newer"
    return case.staleness_of_image(measured.image_sha256, measured.case_revision)


def _usable_localisation(case: Case, number: int) -> LocalisationReceived:
    measured = localisation_of(case, number)
    if measured.verdict != "accepted":
        raise conflict(
            "localisation_rejected",
            f"localisation {number} was rejected ({', '.join(measured.reason_codes)}); take one more image",
        )
    return _newest(case, number)


def _newest(case: Case, number: int) -> LocalisationReceived:
    """A localisation that still holds, accepted or not; raises `Refused`."""
    measured = localisation_of(case, number)
    clause = localisation_staleness(case, measured)
    if clause is not None:
        raise conflict("localisation_stale", f"localisation {number} is stale: {clause}; plan from the newest")
    return measured


def _verified_images(case: Case, number: int) -> tuple[str, ...]:
    """The images of the last verification; raises `Refused`."""
    if not 1 <= number <= len(case.verifications):
        raise unknown("verification", str(number), f"case {case.case_id} has {len(case.verifications)}")
    if number != len(case.verifications):
        newest = len(case.verifications)
        raise conflict("verification_stale", f"verification {newest} is newer than {number}; plan from the newest")
    return case.verifications[number - 1].images


def _require_open(case: Case) -> None:
    if case.progress.closed:
        raise conflict("case_closed", f"case {case.case_id} is {case.progress.stage}: nothing moves any more")


def _require_ready_for_moves(case: Case) -> None:
    _require_open(case)
    require_nothing_inside(sorted(case.progress.inside))
    if case.progress.stage not in _STAGES_FOR_MOVES:
        raise conflict("not_now", f"the case is '{case.progress.stage}': no move is planned or made now")


def _require_answers(plan: Plan, request: PlanRequest) -> None:
    asked = (request.case_id, request.image_sha256, request.hole_ids)
    if (plan.case_id, plan.image_sha256, plan.hole_ids) != asked:
        raise Refused(
            RefusalKind.UNAVAILABLE,
            "plan_inconsistent",
            f"registration answered for case {plan.case_id}, image {plan.image_sha256[:12]}, holes "
            f"{', '.join(plan.hole_ids)}, which is not what was asked; nothing was kept",
        )
