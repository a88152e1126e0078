"""Plans, their approval, and the motions made from them."""

from dataclasses import dataclass

from services.ui_api.core.case import Case, PlanEntry
from services.ui_api.core.event_data import ApprovalWithdrawn, LocalisationReceived, PlanApproved, PlanMade, PlanRefused
from services.ui_api.core.events import EventDraft
from services.ui_api.core.identity import Approver, Authenticated
from services.ui_api.core.operations import Operation
from services.ui_api.core.procedure_table import Action
from services.ui_api.handlers.cases import require_known_holes
from services.ui_api.handlers.commands import Asked, CommandHandler
from services.ui_api.handlers.operation_requests import Move
from services.ui_api.handlers.permits import ApprovedPlan
from services.ui_api.handlers.procedure import ProcedureHandler, localisation_staleness
from services.ui_api.handlers.refusals import RefusalKind, Refused, conflict, unknown
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import UnitOfWork
from shared.bus.keys import Keys
from shared.bus.port import Bus
from shared.messages.base import decode, encode
from shared.messages.registration import Plan, PlanReply, PlanRequest

# Chosen: a plan may wait for the image that is being localised, which takes seconds on a busy machine.
PLAN_TIMEOUT_S = 10.0


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

    def __init__(
        self, bus: Bus, keys: Keys, record: CaseRecord, procedure: ProcedureHandler, commands: CommandHandler
    ) -> None:
        self._bus, self._keys, self._record = bus, keys, record
        self._procedure, self._commands = procedure, commands

    def request(self, case: Case, basis: PlanBasis, hole_ids: tuple[str, ...]) -> PlanRequest:
        """What to ask registration; raises `Refused` where nothing can be planned from that now."""
        self._procedure.require(case, Action.REQUEST_PLAN)
        require_known_holes(hole_ids, case.hole_ids)
        alone = not basis.earlier and basis.verification is None
        measured = (_usable_localisation if alone else _newest)(case, basis.localisation)
        return PlanRequest(
            case_id=case.case_id,
            image_sha256=measured.image_sha256,
            hole_ids=hole_ids,
            earlier_image_sha256=tuple(localisation_of(case, number).image_sha256 for number in basis.earlier),
            verified_image_sha256=() if basis.verification is None else _verified_images(case, basis.verification),
        )

    def ask_for_plan(self, request: PlanRequest) -> PlanReply:
        """Have registration plan; raises `Refused` or `NoReply`. Moves and records nothing."""
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
        self._procedure.require(case, Action.APPROVE_PLAN)
        entry = self._newest_plan(case, number)
        approved = PlanApproved(
            number, entry.made.plan_sha256, approver.name, unit.now_ns, approver.authenticated.value
        )
        unit.append(EventDraft(approved, case.case_id, approver.name))
        return approved

    def begin_motion(self, unit: UnitOfWork, case: Case, request: MotionRequest, asked: Asked) -> Operation:
        """Record and send the motion of an approved plan; raises `Refused`."""
        self._procedure.require(case, Action.START_MOTION)
        entry = self._newest_plan(case, request.plan_number)
        approval = entry.approval
        assert approval is not None  # the table has it
        assert approval.authenticated_by is not None
        approver = Approver(approval.approved_by, Authenticated(approval.authenticated_by))
        move = Move(
            plan_number=request.plan_number,
            plan=ApprovedPlan(approval.plan_sha256, self.plan_content(entry).hole_ids, approver),
            hold_to_move=request.hold_to_move,
        )
        return self._commands.begin_move(unit, case.case_id, request.who, move, asked)

    def withdraw_approval(self, unit: UnitOfWork, case: Case, number: int, who: str) -> None:
        """Take an approval back, as long as no motion has begun from it; raises `Refused`."""
        self._procedure.require(case, Action.WITHDRAW_APPROVAL)
        entry = self._newest_plan(case, number)
        unit.append(EventDraft(ApprovalWithdrawn(number, entry.made.plan_sha256), case.case_id, who))

    def staleness_of(self, case: Case, entry: PlanEntry, plan: Plan | None = None) -> str | None:
        """Why a plan no longer holds, as a clause; None when it does hold."""
        return self._procedure.staleness_of(case, entry, plan)

    def _newest_plan(self, case: Case, number: int) -> PlanEntry:
        """A plan that was asked for, which must be the one that the table speaks of; raises `Refused`."""
        entry = plan_of(case, number)
        clause = self.staleness_of(case, entry)
        if clause is not None:
            raise conflict("plan_stale", f"plan {number} is stale: {clause}; request a new plan")
        return entry


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


def _require_answers(plan: Plan, request: PlanRequest) -> None:
    asked = (request.case_id, request.image_sha256, request.hole_ids)
    if (plan.case_id, plan.image_sha256, plan.hole_ids) != asked:
        raise Refused(
            RefusalKind.UNAVAILABLE,
            "plan_inconsistent",
            f"registration answered for case {plan.case_id}, image {plan.image_sha256[:12]}, holes "
            f"{', '.join(plan.hole_ids)}, which is not what was asked; nothing was kept",
        )
