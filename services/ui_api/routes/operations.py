"""`/operations`: what takes time is followed here, and ended where that is safe."""

from typing import Annotated

from fastapi import Query, Request, Response
from pydantic import BaseModel

from services.ui_api.core.computations import Computation
from services.ui_api.core.ledger import Ledger
from services.ui_api.core.localising import PREFIX, Localising, localising_of, localisings_of
from services.ui_api.core.operations import VERBS_WITH_A_MOTION, Operation
from services.ui_api.core.roles import Action
from services.ui_api.handlers.refusals import Refused, conflict, unknown
from services.ui_api.record.unit_of_work import Answer, UnitOfWork
from services.ui_api.routes.access import TheGateway, TheIdempotency
from services.ui_api.routes.guards import NEVER_LIMITED, TheUser, needs
from services.ui_api.routes.idempotency import IdempotencyKey, json_answer, keyed
from services.ui_api.routes.operation_views import (
    AnyOperation,
    LeaseView,
    OperationStatusName,
    OperationView,
    status_name,
)
from services.ui_api.routes.pages import Cursor, Limit, Page, Since, Sort, is_since, page
from services.ui_api.routes.routers import resource_router
from services.ui_api.service import Gateway

router = resource_router("/operations", tag="operations")
StatusFilter = Annotated[OperationStatusName | None, Query(description="Only those with this status.")]


class _NoBody(BaseModel):
    """Nothing is sent."""


@router.get("", openapi_extra=needs(Action.READ))
def list_operations(
    gateway: TheGateway,
    cursor: Cursor = None,
    limit: Limit = 50,
    status: StatusFilter = None,
    since: Since = None,
    sort: Sort = "oldest",
) -> Page[OperationView]:
    """All operations, in the order in which they were asked for, and images on their way to a localisation."""

    def wanted(operation: AnyOperation) -> bool:
        return status in (None, status_name(operation)) and is_since(operation.requested_at_ns, since)

    ledger = gateway.record.ledger
    localising = (one for case in ledger.cases.values() for one in localisings_of(case))
    found: list[AnyOperation] = [*ledger.operations.values(), *ledger.computations.values(), *localising]
    found.sort(key=lambda operation: operation.requested_at_ns)
    return page(found, cursor, limit, lambda operation: operation_view(gateway, operation), wanted=wanted, sort=sort)


@router.get("/{operation_id}", openapi_extra=needs(Action.READ))
def read_operation(operation_id: str, gateway: TheGateway) -> OperationView:
    """How far an operation has come: as a step of so many, in words, and as a fraction where that is known."""
    return operation_view(gateway, _operation(gateway, operation_id))


@router.post("/{operation_id}/cancel", response_model=OperationView, openapi_extra=needs(Action.COMPUTE))
def cancel_operation(
    operation_id: str,
    request: Request,
    key: IdempotencyKey,
    gateway: TheGateway,
    idempotency: TheIdempotency,
    user: TheUser,
) -> Response:
    """Wait no more for what is computed: nothing of it is kept. What moves the robot is ended by a stop alone."""

    def act(unit: UnitOfWork) -> Answer:
        operation = _operation(gateway, operation_id)
        if not isinstance(operation, Computation):
            raise _not_cancelled(operation)
        gateway.computations.cancel(unit, operation_id, user.name)
        after = gateway.record.ledger.with_events(unit.events)
        return json_answer(200, OperationView.of(after.computations[operation_id]))

    return idempotency.once(keyed(request, key, _NoBody()), act)


@router.put("/{operation_id}/lease", openapi_extra=needs(Action.MOVE) | NEVER_LIMITED)
async def renew_lease(operation_id: str, gateway: TheGateway) -> LeaseView:
    """Go on holding: motion stops when this is not repeated in time. A lapsed lease cannot be renewed."""
    # A coroutine, which reads memory alone: it must not wait for one of the threads that others keep for a minute.
    operation = _operation(gateway, operation_id)
    if operation.ended:
        raise conflict("operation_ended", f"operation {operation_id} has ended: it is '{operation.status}'")
    if not isinstance(operation, Operation) or not operation.requested.hold_to_move:
        raise conflict("no_lease", f"operation {operation_id} was begun without hold_to_move, so it has no lease")
    if not gateway.leases.renew(operation_id):
        raise conflict("lease_lapsed", f"the lease of operation {operation_id} has lapsed: the robot is stopped")
    return LeaseView(operation=operation_id, expires_in_s=gateway.leases.lease_s)


def accepted(operation: Operation | Computation, **headers: str) -> Answer:
    """202 with the operation and where to follow it."""
    location = f"/api/v1/operations/{operation.requested.operation_id}"
    return json_answer(202, OperationView.of(operation), location=location, **headers)


def operation_view(gateway: Gateway, operation: AnyOperation) -> OperationView:
    """An operation as it is now."""
    progress = gateway.progress.of(operation) if isinstance(operation, Operation) else None
    return OperationView.of(operation, progress)


def _operation(gateway: Gateway, operation_id: str) -> AnyOperation:
    ledger = gateway.record.ledger
    asked_for = ledger.operations.get(operation_id) or ledger.computations.get(operation_id)
    operation = asked_for or _localising(ledger, operation_id)
    if operation is None:
        raise unknown("operation", operation_id, "GET /operations lists them")
    return operation


def _localising(ledger: Ledger, operation_id: str) -> Localising | None:
    if not operation_id.startswith(PREFIX):
        return None
    for case in reversed(ledger.cases.values()):
        image = case.image(operation_id.removeprefix(PREFIX))
        if image is not None:
            return localising_of(case, image)
    return None


def _not_cancelled(operation: Operation | Localising) -> Refused:
    if isinstance(operation, Localising):
        return conflict(
            "not_cancellable", "an image is localised by itself, and given up for a newer one; take one more, or wait"
        )
    requested = operation.requested
    name = f"operation {requested.operation_id} ({requested.verb})"
    if operation.ended:
        return conflict("operation_ended", f"{name} has ended: it is '{operation.status}'")
    if requested.verb in VERBS_WITH_A_MOTION:
        return conflict("ended_by_stop", f"{name} moves the robot, and a stop alone ends a motion; POST /robot/stop")
    return conflict("not_cancellable", f"{name} takes but a moment and cannot be taken back; wait until it has ended")
