"""`POST /cases/{id}/operations`: verify, report or plan without waiting for it; `/operations` follows and cancels."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Self, TypeVar

from fastapi import Request, Response
from pydantic import ConfigDict, model_validator

from services.ui_api.core.case import Case
from services.ui_api.core.computations import Computation
from services.ui_api.core.event_data import VerificationRefused
from services.ui_api.core.roles import Action
from services.ui_api.handlers.computations import Outcome, RequestedComputation
from services.ui_api.handlers.planning import PlanBasis
from services.ui_api.record.unit_of_work import Answer, UnitOfWork
from services.ui_api.routes.access import TheGateway, TheIdempotency
from services.ui_api.routes.bodies import Body, PlanBody, QaBody, VerificationBody
from services.ui_api.routes.guards import TheUser, needs
from services.ui_api.routes.idempotency import IdempotencyKey, keyed
from services.ui_api.routes.operation_views import OperationView
from services.ui_api.routes.operations import accepted
from services.ui_api.routes.preconditions import CaseMatch, case_etag_after, matched_case
from services.ui_api.routes.problems import problem_of
from services.ui_api.routes.routers import resource_router
from services.ui_api.service import Gateway
from shared.errors import DistalockError
from shared.messages.qa import QaReply
from shared.messages.registration import PlanReply, VerificationReply

router = resource_router("/cases/{case_id}/operations", tag="operations")
T = TypeVar("T")


class ComputationBody(Body):
    """What to compute: exactly one of the three, each as in the body of its own `POST`, which waits for the answer."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    verification: VerificationBody | None = None
    qa_report: QaBody | None = None
    plan: PlanBody | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        given = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(given) != 1:
            found = ", ".join(given) or "none"
            raise ValueError(f"give exactly one of {', '.join(type(self).model_fields)}; given was {found}")
        return self


@dataclass(frozen=True, slots=True)
class _Wanted(Generic[T]):
    """A computation that may begin."""

    requested: RequestedComputation
    ask: Callable[[], T]
    keep: Callable[[UnitOfWork, T], Outcome]


@router.post("", status_code=202, response_model=OperationView, openapi_extra=needs(Action.COMPUTE))
def begin_computation(
    case_id: str,
    request: Request,
    body: ComputationBody,
    key: IdempotencyKey,
    if_match: CaseMatch,
    gateway: TheGateway,
    idempotency: TheIdempotency,
    user: TheUser,
) -> Response:
    """Verify, report on images, or plan, without waiting for it; the operation can be followed and cancelled.

    What can be refused at once is refused at once; the operation's `result` is the path of what was made.
    """

    def act(unit: UnitOfWork) -> Answer:
        case = matched_case(gateway, case_id, if_match)
        begun = _begin(gateway, unit, case, body, user.name)
        return accepted(begun, case_etag=case_etag_after(gateway, case_id, unit))

    return idempotency.once(keyed(request, key, body), act)


def _begin(gateway: Gateway, unit: UnitOfWork, case: Case, body: ComputationBody, who: str) -> Computation:
    if body.verification is not None:
        return _begun(gateway, unit, _verification(gateway, case, body.verification, who))
    if body.qa_report is not None:
        return _begun(gateway, unit, _qa_report(gateway, case, body.qa_report, who))
    assert body.plan is not None  # the body has one of them
    return _begun(gateway, unit, _plan(gateway, case, body.plan, who))


def _begun(gateway: Gateway, unit: UnitOfWork, wanted: "_Wanted[T]") -> Computation:
    return gateway.computations.begin(unit, wanted.requested, wanted.ask, wanted.keep, _explained)


def _explained(error: DistalockError) -> tuple[str, str]:
    found = problem_of(error, "")
    return found.code, found.detail


def _verification(gateway: Gateway, case: Case, body: VerificationBody, who: str) -> _Wanted[VerificationReply]:
    images, verifications, case_id = tuple(body.images), gateway.verifications, case.case_id
    request = verifications.request(case, images, body.of)

    def keep(unit: UnitOfWork, reply: VerificationReply) -> Outcome:
        kept = verifications.keep(unit, case_id, images, reply)
        if isinstance(kept, VerificationRefused):
            return Outcome(None, kept.code, kept.message)
        return Outcome(f"/api/v1/cases/{case_id}/verifications/{kept}")

    says = f"verification of the {body.of} in {_images(images)}"
    requested = RequestedComputation("verify", case_id, who, says, f"registration compares the {body.of} with the axes")
    return _Wanted(requested, lambda: verifications.ask(request), keep)


def _qa_report(gateway: Gateway, case: Case, body: QaBody, who: str) -> _Wanted[QaReply]:
    images, quality, case_id = tuple(body.images), gateway.quality, case.case_id
    request = quality.request(case, images)

    def keep(unit: UnitOfWork, reply: QaReply) -> Outcome:
        number = None if reply.report is None else quality.keep(unit, case_id, images, reply.report, reply.page)
        return _outcome(number, f"/api/v1/cases/{case_id}/qa-reports", reply.code or "no_report", reply.message)

    says = f"quality report on {_images(images)}"
    requested = RequestedComputation("report_quality", case_id, who, says, f"imaging calibrates {_images(images)}")
    return _Wanted(requested, lambda: quality.ask(request), keep)


def _plan(gateway: Gateway, case: Case, body: PlanBody, who: str) -> _Wanted[PlanReply]:
    hole_ids, planning, case_id = tuple(body.hole_ids), gateway.planning, case.case_id
    basis = PlanBasis(body.localisation, tuple(body.localisations), body.verification)
    request = planning.request(case, basis, hole_ids)

    def keep(unit: UnitOfWork, reply: PlanReply) -> Outcome:
        number = planning.keep_plan(unit, case_id, body.localisation, hole_ids, reply)
        return _outcome(number, f"/api/v1/cases/{case_id}/plans", reply.code or "no_plan", reply.message)

    says = f"plan from localisation {body.localisation} for {', '.join(hole_ids)}"
    requested = RequestedComputation("plan", case_id, who, says, "registration looks for the move")
    return _Wanted(requested, lambda: planning.ask_for_plan(request), keep)


def _outcome(number: int | None, path: str, code: str, message: str) -> Outcome:
    """What was made under this path, or why nothing was."""
    return Outcome(None, code, message) if number is None else Outcome(f"{path}/{number}")


def _images(images: tuple[str, ...]) -> str:
    return "one image" if len(images) == 1 else f"{len(images)} images"
