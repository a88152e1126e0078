"""`/cases`: open, list, read, change; `/cases/{id}/steps`: what people did with their hands."""

from collections.abc import Mapping
from typing import Annotated, Literal

from fastapi import Query, Request, Response
from fastapi.concurrency import run_in_threadpool

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import PartUse
from services.ui_api.core.roles import Action
from services.ui_api.handlers.cases import StepRequest
from services.ui_api.record.unit_of_work import Answer, UnitOfWork
from services.ui_api.routes.access import TheGateway, TheIdempotency, TheKeptViews, gateway_of, kept_views_of
from services.ui_api.routes.bodies import CaseBody, CasePatch, StepBody
from services.ui_api.routes.guards import TheUser, needs
from services.ui_api.routes.idempotency import IdempotencyKey, json_answer, keyed
from services.ui_api.routes.kept_views import KeptViews
from services.ui_api.routes.pages import Cursor, Limit, Page, Since, Sort, is_since, page
from services.ui_api.routes.preconditions import CaseMatch, case_etag_after, case_view, matched_case
from services.ui_api.routes.procedure_views import StepView
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.sparse import SPARSE
from services.ui_api.routes.transactions import TheWrite
from services.ui_api.routes.views import CaseView
from services.ui_api.service import Gateway
from shared.parts.catalogue import PartKind

router = resource_router("/cases", tag="cases")
CaseStatus = Annotated[Literal["open", "closed"] | None, Query(description="Only those that are so.")]


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
        etag = case_etag_after(gateway, case_id, unit)
        return json_answer(201, _preview(unit, gateway, case_id), location=f"/api/v1/cases/{case_id}", case_etag=etag)

    return idempotency.once(keyed(request, key, body), act)


@router.get("", dependencies=SPARSE, openapi_extra=needs(Action.READ))
def list_cases(
    gateway: TheGateway,
    cursor: Cursor = None,
    limit: Limit = 50,
    status: CaseStatus = None,
    since: Since = None,
    sort: Sort = "oldest",
) -> Page[CaseView]:
    """All cases; `since` is of the last change."""

    def wanted(case: Case) -> bool:
        return status in (None, "closed" if case.progress.closed else "open") and is_since(case.changed_at_ns, since)

    def view(case: Case) -> CaseView:
        return case_view(gateway, case)

    return page(list(gateway.record.ledger.cases.values()), cursor, limit, view, wanted=wanted, sort=sort)


@router.get("/{case_id}", response_model=CaseView, openapi_extra=needs(Action.READ))
async def read_case(case_id: str, request: Request) -> Response:
    """A case with the state of its procedure and the next allowed actions."""
    gateway, kept = gateway_of(request), kept_views_of(request)
    case = gateway.cases.case(case_id)
    if gateway.procedure.is_at_hand(case):
        return _answer(gateway, kept, case)
    return await run_in_threadpool(_answer, gateway, kept, case)  # the database is asked


@router.get("/{case_id}/parts/{kind}", openapi_extra=needs(Action.READ))
def read_case_part(case_id: str, kind: PartKind, gateway: TheGateway) -> Response:
    """The ring, guide, nail or hexapod file as the case uses it, byte for byte: own files and calibrations too."""
    setup = gateway.cases.case(case_id).setup
    uses: Mapping[PartKind, PartUse] = {
        "ring": setup.ring,
        "guide": setup.guide,
        "nail": setup.nail,
        "hexapod": setup.hexapod,
    }
    return Response(gateway.record.document(uses[kind].sha256), media_type="application/json")


@router.patch("/{case_id}", response_model=CaseView, openapi_extra=needs(Action.CHANGE_SET_UP))
def change_case(
    case_id: str,
    body: CasePatch,
    gateway: TheGateway,
    kept: TheKeptViews,
    write: TheWrite,
    user: TheUser,
    if_match: CaseMatch,
) -> Response:
    """Change the set-up: the revision counts up, and everything measured before is stale."""
    with write() as unit:
        matched_case(gateway, case_id, if_match)
        gateway.cases.change_setup(unit, case_id, body.request(), user.name, body.why)
    return _answer(gateway, kept, gateway.cases.case(case_id))


@router.post("/{case_id}/steps", status_code=201, response_model=CaseView, openapi_extra=needs(Action.RECORD_STEP))
def record_step(
    case_id: str,
    request: Request,
    body: StepBody,
    key: IdempotencyKey,
    if_match: CaseMatch,
    gateway: TheGateway,
    idempotency: TheIdempotency,
    user: TheUser,
) -> Response:
    """Record what people did with their hands; `finished` and `abandoned` close the case."""

    def act(unit: UnitOfWork) -> Answer:
        matched_case(gateway, case_id, if_match)
        step = StepRequest(body.as_step(), tuple(body.hole_ids), user.name, body.why)
        gateway.cases.record_step(unit, case_id, step)
        etag = case_etag_after(gateway, case_id, unit)
        return json_answer(201, _preview(unit, gateway, case_id), case_etag=etag)

    return idempotency.once(keyed(request, key, body), act)


@router.get("/{case_id}/steps", openapi_extra=needs(Action.READ))
def list_steps(case_id: str, gateway: TheGateway, cursor: Cursor = None, limit: Limit = 50) -> Page[StepView]:
    """Steps that were recorded and not withdrawn, the oldest first."""
    return page(gateway.cases.case(case_id).step_entries, cursor, limit, StepView.of)


@router.delete("/{case_id}/steps/{number}", response_model=CaseView, openapi_extra=needs(Action.RECORD_STEP))
def withdraw_step(
    case_id: str, number: int, gateway: TheGateway, kept: TheKeptViews, write: TheWrite, user: TheUser
) -> Response:
    """Take back the step that was recorded last, because it was not done."""
    with write() as unit:
        gateway.cases.withdraw_step(unit, case_id, number, user.name)
    return _answer(gateway, kept, gateway.cases.case(case_id))


def _answer(gateway: Gateway, kept: KeptViews, case: Case) -> Response:
    """A case and its ETag."""
    found = kept.case(gateway, case)
    headers = {"ETag": found.etag, "Case-ETag": found.etag}
    return Response(found.content, headers=headers, media_type="application/json")


def _preview(unit: UnitOfWork, gateway: Gateway, case_id: str) -> CaseView:
    """The case as it will be once the transaction is on the disk."""
    return case_view(gateway, gateway.record.ledger.case_after(case_id, unit.events))
