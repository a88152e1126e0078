"""`/cases`: open, list, read, change; `/cases/{id}/steps`: what people did with their hands."""

from typing import Annotated

from fastapi import APIRouter, Header, Request, Response

from services.ui_api.core.case import Case
from services.ui_api.core.roles import Action
from services.ui_api.handlers.cases import StepRequest
from services.ui_api.handlers.refusals import RefusalKind, Refused
from services.ui_api.record.unit_of_work import Answer, UnitOfWork
from services.ui_api.routes.access import TheGateway, TheIdempotency
from services.ui_api.routes.bodies import CaseBody, CasePatch, StepBody
from services.ui_api.routes.guards import GuardedRoute, TheUser, needs
from services.ui_api.routes.idempotency import IdempotencyKey, json_answer, keyed
from services.ui_api.routes.pages import Cursor, Limit, Page, page
from services.ui_api.routes.procedure_views import StepView
from services.ui_api.routes.views import CaseView
from services.ui_api.service import Gateway

router = APIRouter(route_class=GuardedRoute, prefix="/cases", tags=["cases"])


@router.post("", status_code=201, response_model=CaseView, openapi_extra=needs(Action.OPEN_CASE))
def open_case(
    request: Request,
    body: CaseBody,
    key: IdempotencyKey,
    gateway: TheGateway,
    idempotency: TheIdempotency,
    user: TheUser,
) -> Response:
    """Open a case; one at a time in this room."""

    def act(unit: UnitOfWork) -> Answer:
        case_id = gateway.cases.open_case(unit, body.request(), user.name)
        return json_answer(201, _preview(unit, gateway, case_id), location=f"/api/v1/cases/{case_id}")

    return idempotency.once(keyed(request, key, body), act)


@router.get("", openapi_extra=needs(Action.READ))
def list_cases(gateway: TheGateway, cursor: Cursor = None, limit: Limit = 50) -> Page[CaseView]:
    """All cases, the oldest first."""
    return page(list(gateway.record.ledger.cases.values()), cursor, limit, lambda case: _view(gateway, case))


@router.get("/{case_id}", response_model=CaseView, openapi_extra=needs(Action.READ))
def read_case(case_id: str, response: Response, gateway: TheGateway) -> CaseView:
    """A case with the state of its procedure and the next allowed actions."""
    case = gateway.cases.case(case_id)
    response.headers["ETag"] = _etag(case.revision)
    return _view(gateway, case)


@router.patch("/{case_id}", response_model=CaseView, openapi_extra=needs(Action.CHANGE_SET_UP))
def change_case(
    case_id: str,
    body: CasePatch,
    response: Response,
    gateway: TheGateway,
    user: TheUser,
    if_match: Annotated[str | None, Header(description="ETag of the case that was read.")] = None,
) -> CaseView:
    """Change the set-up: the revision counts up, and everything measured before is stale."""
    with gateway.record.write() as unit:
        revision = gateway.cases.case(case_id).revision
        if if_match is not None and if_match != _etag(revision):
            raise Refused(
                RefusalKind.PRECONDITION_FAILED,
                "case_changed",
                f"If-Match is {if_match}, but the case is at {_etag(revision)}; read it again",
            )
        gateway.cases.change_setup(unit, case_id, body.request(), user.name, body.why)
    return read_case(case_id, response, gateway)


@router.post("/{case_id}/steps", status_code=201, response_model=CaseView, openapi_extra=needs(Action.RECORD_STEP))
def record_step(
    case_id: str,
    request: Request,
    body: StepBody,
    key: IdempotencyKey,
    gateway: TheGateway,
    idempotency: TheIdempotency,
    user: TheUser,
) -> Response:
    """Record what people did with their hands; `finished` and `abandoned` close the case."""

    def act(unit: UnitOfWork) -> Answer:
        step = StepRequest(body.as_step(), tuple(body.hole_ids), user.name, body.why)
        gateway.cases.record_step(unit, case_id, step)
        return json_answer(201, _preview(unit, gateway, case_id))

    return idempotency.once(keyed(request, key, body), act)


@router.get("/{case_id}/steps", openapi_extra=needs(Action.READ))
def list_steps(case_id: str, gateway: TheGateway, cursor: Cursor = None, limit: Limit = 50) -> Page[StepView]:
    """Steps that were recorded and not withdrawn, the oldest first."""
    return page(gateway.cases.case(case_id).step_entries, cursor, limit, StepView.of)


@router.delete("/{case_id}/steps/{number}", response_model=CaseView, openapi_extra=needs(Action.RECORD_STEP))
def withdraw_step(case_id: str, number: int, response: Response, gateway: TheGateway, user: TheUser) -> CaseView:
    """Take back the step that was recorded last, because it was not done."""
    with gateway.record.write() as unit:
        gateway.cases.withdraw_step(unit, case_id, number, user.name)
    return read_case(case_id, response, gateway)


def _preview(unit: UnitOfWork, gateway: Gateway, case_id: str) -> CaseView:
    """The case as it will be once the transaction is on the disk."""
    return _view(gateway, gateway.record.ledger.case_after(case_id, unit.events))


def _view(gateway: Gateway, case: Case) -> CaseView:
    return CaseView.of(case, gateway.procedure.situation(case))


def _etag(revision: int) -> str:
    return f'"{revision}"'
