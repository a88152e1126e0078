"""`/cases/{id}/motions`: motions are begun here, and followed at `/operations`."""

from fastapi import Request, Response

from services.ui_api.core.roles import Action
from services.ui_api.handlers.planning import MotionRequest
from services.ui_api.record.unit_of_work import Answer, UnitOfWork
from services.ui_api.routes.access import TheGateway, TheIdempotency
from services.ui_api.routes.bodies import MotionBody
from services.ui_api.routes.guards import TheAsked, TheUser, needs
from services.ui_api.routes.idempotency import IdempotencyKey, keyed
from services.ui_api.routes.operation_views import OperationView
from services.ui_api.routes.operations import accepted
from services.ui_api.routes.preconditions import CaseMatch, case_etag_after, matched_case
from services.ui_api.routes.routers import resource_router

router = resource_router(tag="motions")


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
    asked: TheAsked,
) -> Response:
    """Begin the move to an approved plan's target; its operation reports how it ends."""

    def act(unit: UnitOfWork) -> Answer:
        wanted = MotionRequest(body.plan, body.hold_to_move, user.name)
        case = matched_case(gateway, case_id, if_match)
        begun = gateway.planning.begin_motion(unit, case, wanted, asked)
        return accepted(begun, case_etag=case_etag_after(gateway, case_id, unit))

    return idempotency.once(keyed(request, key, body), act)
