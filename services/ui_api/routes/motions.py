"""`/cases/{id}/motions` and `/operations`: motions are begun here and followed there."""

from typing import Annotated

from fastapi import Query, Request, Response

from services.ui_api.core.operations import Operation
from services.ui_api.core.roles import Action
from services.ui_api.handlers.planning import MotionRequest
from services.ui_api.handlers.refusals import conflict, unknown
from services.ui_api.record.unit_of_work import Answer, UnitOfWork
from services.ui_api.routes.access import TheGateway, TheIdempotency
from services.ui_api.routes.bodies import MotionBody
from services.ui_api.routes.guards import NEVER_LIMITED, TheUser, needs
from services.ui_api.routes.idempotency import IdempotencyKey, json_answer, keyed
from services.ui_api.routes.motion_views import LeaseView, OperationStatusName, OperationView, status_name
from services.ui_api.routes.pages import Cursor, Limit, Page, Since, Sort, is_since, page
from services.ui_api.routes.preconditions import CaseMatch, case_etag_after, matched_case
from services.ui_api.routes.routers import resource_router
from services.ui_api.service import Gateway

router = resource_router(tag="motions")
StatusFilter = Annotated[OperationStatusName | None, Query(description="Only those with this status.")]


@router.post(
    "/cases/{case_id}/motions", status_code=202, response_model=OperationView, openapi_extra=needs(Action.MOVE)
)
def begin_motion(
    case_id: str,
    request: Request,
    body: MotionBody,
    key: IdempotencyKey,
    if_match: CaseMatch,
    gateway: TheGateway,
    idempotency: TheIdempotency,
    user: TheUser,
) -> Response:
    """Begin the motion of an approved plan; the operation tells how it ends."""

    def act(unit: UnitOfWork) -> Answer:
        wanted = MotionRequest(body.plan, body.hold_to_move, user.name)
        case = matched_case(gateway, case_id, if_match)
        begun = gateway.planning.begin_motion(unit, case, wanted)
        return accepted(begun, case_etag=case_etag_after(gateway, case_id, unit))

    return idempotency.once(keyed(request, key, body), act)


@router.get("/operations", openapi_extra=needs(Action.READ))
def list_operations(
    gateway: TheGateway,
    cursor: Cursor = None,
    limit: Limit = 50,
    status: StatusFilter = None,
    since: Since = None,
    sort: Sort = "oldest",
) -> Page[OperationView]:
    """All operations."""

    def wanted(operation: Operation) -> bool:
        return status in (None, status_name(operation)) and is_since(operation.requested_at_ns, since)

    return page(
        list(gateway.record.ledger.operations.values()), cursor, limit, OperationView.of, wanted=wanted, sort=sort
    )


@router.get("/operations/{operation_id}", openapi_extra=needs(Action.READ))
def read_operation(operation_id: str, gateway: TheGateway) -> OperationView:
    """How far an operation has come."""
    return OperationView.of(_operation(gateway, operation_id))


@router.put("/operations/{operation_id}/lease", openapi_extra=needs(Action.MOVE) | NEVER_LIMITED)
def renew_lease(operation_id: str, gateway: TheGateway) -> LeaseView:
    """Go on holding: motion stops when this is not repeated in time. A lapsed lease cannot be renewed."""
    operation = _operation(gateway, operation_id)
    if operation.ended:
        raise conflict("operation_ended", f"operation {operation_id} has ended: it is '{operation.status}'")
    if not operation.requested.hold_to_move:
        raise conflict("no_lease", f"operation {operation_id} was begun without hold_to_move, so it has no lease")
    if not gateway.leases.renew(operation_id):
        raise conflict("lease_lapsed", f"the lease of operation {operation_id} has lapsed: the robot is stopped")
    return LeaseView(operation=operation_id, expires_in_s=gateway.leases.lease_s)


def accepted(operation: Operation, **headers: str) -> Answer:
    """202 with the operation and where to follow it."""
    location = f"/api/v1/operations/{operation.requested.operation_id}"
    return json_answer(202, OperationView.of(operation), location=location, **headers)


def _operation(gateway: Gateway, operation_id: str) -> Operation:
    operation = gateway.record.ledger.operations.get(operation_id)
    if operation is None:
        raise unknown("operation", operation_id, "GET /operations lists them")
    return operation
