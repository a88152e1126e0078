"""`/cases/{id}/plans`: from a localisation to a plan that a surgeon has approved."""

from typing import Annotated

from fastapi import Header, Request, Response

from services.ui_api.core.case import Case, PlanEntry
from services.ui_api.core.identity import Approver, Authenticated
from services.ui_api.core.roles import Action
from services.ui_api.handlers.planning import PlanBasis, plan_of
from services.ui_api.record.unit_of_work import Answer, UnitOfWork
from services.ui_api.routes.access import TheGateway, TheIdempotency
from services.ui_api.routes.bodies import ApprovalBody, PlanBody
from services.ui_api.routes.guards import TheUser, needs
from services.ui_api.routes.idempotency import IdempotencyKey, json_answer, keyed, problem_answer
from services.ui_api.routes.motion_views import ApprovalView, PlanView
from services.ui_api.routes.pages import Cursor, HoleFilter, Limit, Page, Since, Sort, is_since, page
from services.ui_api.routes.preconditions import CaseMatch, case_etag_after, matched_case, stale_precondition
from services.ui_api.routes.problems import problem, sender_of
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.sparse import SPARSE
from services.ui_api.routes.transactions import TheWrite
from services.ui_api.service import Gateway
from shared.messages.registration import PlanReply

router = resource_router("/cases/{case_id}/plans", tag="plans")
# Registration's codes for what the request itself got wrong; all others are about the state of things.
_CODES_OF_BAD_REQUESTS = frozenset({"unknown_hole", "image_twice"})


@router.post("", status_code=201, response_model=PlanView, openapi_extra=needs(Action.PLAN))
def make_plan(
    case_id: str,
    request: Request,
    body: PlanBody,
    key: IdempotencyKey,
    if_match: CaseMatch,
    gateway: TheGateway,
    idempotency: TheIdempotency,
) -> Response:
    """Plan the move that brings guide and nail axes together; moves nothing."""
    hole_ids = tuple(body.hole_ids)
    basis = PlanBasis(body.localisation, tuple(body.localisations), body.verification)

    def ask() -> PlanReply:
        planning, case = gateway.planning, matched_case(gateway, case_id, if_match)
        return planning.ask_for_plan(planning.request(case, basis, hole_ids))

    def act(unit: UnitOfWork, reply: PlanReply) -> Answer:
        number = gateway.planning.keep_plan(unit, case_id, body.localisation, hole_ids, reply)
        if number is None or reply.plan is None:
            status = 422 if reply.code in _CODES_OF_BAD_REQUESTS else 409
            return problem_answer(problem(status, reply.code or "no_plan", reply.message, request.url.path))
        case = gateway.record.ledger.case_after(case_id, unit.events)
        entry = plan_of(case, number)
        view = PlanView.of(entry, reply.plan, gateway.planning.staleness_of(case, entry, reply.plan))
        location = f"{request.url.path}/{number}"
        newest = case_etag_after(gateway, case_id, unit)
        return json_answer(201, view, etag=etag(entry), location=location, case_etag=newest)

    return idempotency.once_after(keyed(request, key, body), ask, act)


@router.get("", dependencies=SPARSE, openapi_extra=needs(Action.READ))
def list_plans(
    case_id: str,
    gateway: TheGateway,
    cursor: Cursor = None,
    limit: Limit = 50,
    hole: HoleFilter = None,
    since: Since = None,
    sort: Sort = "oldest",
) -> Page[PlanView]:
    """The plans of a case."""
    case = gateway.cases.case(case_id)

    def wanted(entry: PlanEntry) -> bool:
        return (hole is None or hole in entry.made.hole_ids) and is_since(entry.made_at_ns, since)

    return page(case.plans, cursor, limit, lambda entry: _view(gateway, case, entry), wanted=wanted, sort=sort)


@router.get("/{number}", response_model=PlanView, openapi_extra=needs(Action.READ))
def read_plan(case_id: str, number: int, response: Response, gateway: TheGateway) -> PlanView:
    """A plan; its ETag is what an approval quotes."""
    case = gateway.cases.case(case_id)
    entry = plan_of(case, number)
    # The ETag is of what is approved; approval and validity beside it change, so that 304 would hide something.
    response.headers["ETag"], response.headers["Cache-Control"] = etag(entry), "no-store"
    return _view(gateway, case, entry)


@router.post(
    "/{number}/approval", status_code=201, response_model=ApprovalView, openapi_extra=needs(Action.APPROVE_PLAN)
)
def approve_plan(
    case_id: str,
    number: int,
    request: Request,
    body: ApprovalBody,
    key: IdempotencyKey,
    if_match: Annotated[str, Header(alias="If-Match", description="ETag of the plan that was read.")],
    gateway: TheGateway,
    idempotency: TheIdempotency,
    user: TheUser,
) -> Response:
    """Approve exactly the plan that was read, as a surgeon, with the credential once more."""
    asked = keyed(request, key, body, if_match)
    # a challenge is good once: the answer to a request that is sent again is remembered
    is_repeated = body.passkey is not None and idempotency.has_answered(asked)
    shown = Authenticated.PASSKEY if is_repeated else _confirmed(request, body, if_match)

    def act(unit: UnitOfWork) -> Answer:
        case = gateway.cases.case(case_id)
        _require_match(gateway, case, plan_of(case, number), if_match)
        approved = gateway.planning.approve(unit, case, number, Approver(user.name, shown))
        view = ApprovalView(
            plan=number,
            plan_sha256=approved.plan_sha256,
            approved_by=approved.approved_by,
            approved_at_ns=approved.approved_at_ns,
            authenticated_by=approved.authenticated_by,
        )
        return json_answer(201, view, case_etag=case_etag_after(gateway, case_id, unit))

    return idempotency.once(asked, act)


@router.delete("/{number}/approval", response_model=PlanView, openapi_extra=needs(Action.APPROVE_PLAN))
def withdraw_approval(case_id: str, number: int, gateway: TheGateway, write: TheWrite, user: TheUser) -> PlanView:
    """Take an approval back, as long as no motion has begun from it; then stop is what is left."""
    with write() as unit:
        gateway.planning.withdraw_approval(unit, gateway.cases.case(case_id), number, user.name)
    case = gateway.cases.case(case_id)
    return _view(gateway, case, plan_of(case, number))


def _confirmed(request: Request, body: ApprovalBody, if_match: str) -> Authenticated:
    """How the surgeon shows once more who he is; raises `Refused`."""
    gateway: Gateway = request.app.state.gateway
    access, user = gateway.access, request.state.user
    if body.passkey is not None:
        return access.confirmed_by_passkey(user, if_match.strip().strip('"'), body.passkey)
    password = None if body.password is None else body.password.get_secret_value()
    return access.confirmed(user, password, sender_of(request))


def etag(entry: PlanEntry) -> str:
    """ETag of a plan: its hash."""
    return f'"{entry.made.plan_sha256}"'


def _require_match(gateway: Gateway, case: Case, entry: PlanEntry, if_match: str) -> None:
    """Neither `*` nor a list will do: consent is to one plan, by its hash."""
    if if_match.strip() != etag(entry):
        is_bare = f'"{if_match.strip()}"' == etag(entry)
        raise stale_precondition(
            "plan_hash_mismatch",
            f"If-Match is {if_match[:80]}, but the ETag of plan {entry.made.number} is {etag(entry)}; "
            + ("send it with its quotation marks" if is_bare else "read the plan that is to be approved"),
            _view(gateway, case, entry),
            etag(entry),
        )


def _view(gateway: Gateway, case: Case, entry: PlanEntry) -> PlanView:
    plan = gateway.planning.plan_content(entry)
    return PlanView.of(entry, plan, gateway.planning.staleness_of(case, entry, plan))
