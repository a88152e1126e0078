"""`/robot`: its state, and the commands that need no plan. Stop has a path of its own."""

import asyncio

from fastapi import Request, Response

from services.ui_api.core import procedure_table
from services.ui_api.core.identity import Approver, User
from services.ui_api.core.roles import Action
from services.ui_api.handlers.commands import Asked, PlainVerb
from services.ui_api.record.unit_of_work import Answer, UnitOfWork
from services.ui_api.routes.access import TheGateway, TheIdempotency, gateway_of, kept_views_of
from services.ui_api.routes.bodies import CommandBody
from services.ui_api.routes.guards import TheAsked, TheUser, needs
from services.ui_api.routes.idempotency import Idempotency, IdempotencyKey, Keyed, keyed
from services.ui_api.routes.motion_views import RobotView, StopView, says_simulated
from services.ui_api.routes.operation_views import OperationView
from services.ui_api.routes.operations import accepted
from services.ui_api.routes.problems import problem, problem_response
from services.ui_api.routes.routers import resource_router
from services.ui_api.service import Gateway

router = resource_router("/robot", tag="robot")
RECORD_WITHIN_S = 2.0
_BY_REST = "stop requested over REST"
_ANONYMOUS = CommandBody()


@router.get("", response_model=RobotView, openapi_extra=needs(Action.READ))
async def read_robot(request: Request) -> Response:
    """The robot as last seen, its age, and whether it says that it is simulated."""
    gateway = gateway_of(request)
    seen = gateway.view.newest()
    presence = gateway.inbox.presence
    view = RobotView(
        state=None if seen is None else seen.state,
        age_s=gateway.view.age_s(),
        validity=gateway.view.validity(),
        service_alive=presence.alive["robot"],
        simulated=None if seen is None else says_simulated(seen.state.controller_identity),
        image_source=presence.image_source,
        image_source_simulated=says_simulated(presence.image_source),
        actions=kept_views_of(request).robot_actions(gateway),
    )
    return Response(view.model_dump_json(by_alias=True), media_type="application/json")


@router.post("/stop", response_model=StopView, openapi_extra=needs(Action.STOP))
async def stop_robot(request: Request, gateway: TheGateway) -> Response:
    """Stop the robot now. Needs no key and no body, and waits for nothing but the robot's confirmation."""
    outcome = await asyncio.wrap_future(gateway.stop_sender.begin(_BY_REST))
    recording = gateway.stop_recorder.put(outcome, _BY_REST, "rest")
    recorded = bool((await asyncio.wait([asyncio.wrap_future(recording)], timeout=RECORD_WITHIN_S))[0])
    if not outcome.confirmed:
        return problem_response(problem(504, "stop_not_confirmed", outcome.message, request.url.path))
    view = StopView(confirmed=True, state=outcome.state, detail=outcome.message, recorded=recorded)
    return Response(view.model_dump_json(), media_type="application/json")


@router.post("/reference", status_code=202, response_model=OperationView, openapi_extra=needs(Action.PREPARE_ROBOT))
def reference_robot(
    request: Request,
    key: IdempotencyKey,
    gateway: TheGateway,
    idempotency: TheIdempotency,
    user: TheUser,
    asked: TheAsked,
    body: CommandBody = _ANONYMOUS,
) -> Response:
    """Reference the hexapod: only in set-up, with the guide off the bone."""
    return _begin(keyed(request, key, body), user, gateway, idempotency, asked, "reference")


@router.post(
    "/acknowledge-stop", status_code=202, response_model=OperationView, openapi_extra=needs(Action.PREPARE_ROBOT)
)
def acknowledge_stop(
    request: Request,
    key: IdempotencyKey,
    gateway: TheGateway,
    idempotency: TheIdempotency,
    user: TheUser,
    asked: TheAsked,
    body: CommandBody = _ANONYMOUS,
) -> Response:
    """Release a stop, as a person who has looked."""
    return _begin(keyed(request, key, body), user, gateway, idempotency, asked, "acknowledge_stop")


@router.post("/reset", status_code=202, response_model=OperationView, openapi_extra=needs(Action.PREPARE_ROBOT))
def reset_robot(
    request: Request,
    key: IdempotencyKey,
    gateway: TheGateway,
    idempotency: TheIdempotency,
    user: TheUser,
    asked: TheAsked,
    body: CommandBody = _ANONYMOUS,
) -> Response:
    """Leave a fault by connecting anew, after a person has seen to it; the robot is `stopped` then."""
    return _begin(keyed(request, key, body), user, gateway, idempotency, asked, "reset")


def _begin(
    request: Keyed, user: User, gateway: Gateway, idempotency: Idempotency, asked: Asked, verb: PlainVerb
) -> Response:
    def act(unit: UnitOfWork) -> Answer:
        gateway.procedure.require_of_robot(procedure_table.Action(verb))
        return accepted(gateway.commands.begin_plain(unit, verb, Approver(user.name, user.authenticated), asked))

    return idempotency.once(request, act)
