"""`/cases/{id}/verifications`: wires and guide holes against the nail's hole axes."""

from fastapi import Request, Response

from services.ui_api.core.event_data import VerificationMade, VerificationRefused
from services.ui_api.core.roles import Action
from services.ui_api.record.unit_of_work import Answer, UnitOfWork
from services.ui_api.routes.access import TheGateway, TheIdempotency
from services.ui_api.routes.bodies import VerificationBody
from services.ui_api.routes.guards import needs
from services.ui_api.routes.idempotency import IdempotencyKey, json_answer, keyed, problem_answer
from services.ui_api.routes.pages import Cursor, Limit, Page, Sort, VerdictFilter, page
from services.ui_api.routes.preconditions import CaseMatch, case_etag_after, matched_case
from services.ui_api.routes.problems import problem
from services.ui_api.routes.result_views import VerificationView
from services.ui_api.routes.routers import resource_router
from shared.messages.registration import Verification, VerificationReply

router = resource_router("/cases/{case_id}/verifications", tag="verifications")


@router.post("", status_code=201, response_model=VerificationView, openapi_extra=needs(Action.VERIFY))
def make_verification(
    case_id: str,
    request: Request,
    body: VerificationBody,
    key: IdempotencyKey,
    if_match: CaseMatch,
    gateway: TheGateway,
    idempotency: TheIdempotency,
) -> Response:
    """Compare wires, or the guide alone, in one image or two with the nail's hole axes."""
    images = tuple(body.images)

    def ask() -> VerificationReply:
        verifications = gateway.verifications
        return verifications.ask(verifications.request(matched_case(gateway, case_id, if_match), images, body.of))

    def act(unit: UnitOfWork, reply: VerificationReply) -> Answer:
        kept = gateway.verifications.keep(unit, case_id, images, reply)
        if isinstance(kept, VerificationRefused):
            return problem_answer(problem(409, kept.code, kept.message, request.url.path))
        assert reply.verification is not None  # it was kept
        location = f"{request.url.path}/{kept}"
        newest = case_etag_after(gateway, case_id, unit)
        return json_answer(201, _view(kept, reply.verification), location=location, case_etag=newest)

    return idempotency.once_after(keyed(request, key, body), ask, act)


@router.get("", openapi_extra=needs(Action.READ))
def list_verifications(
    case_id: str,
    gateway: TheGateway,
    cursor: Cursor = None,
    limit: Limit = 50,
    verdict: VerdictFilter = None,
    sort: Sort = "oldest",
) -> Page[VerificationView]:
    """The verifications of a case."""
    case = gateway.cases.case(case_id)

    def view(made: VerificationMade) -> VerificationView:
        return _view(made.number, gateway.verifications.content(case, made.number))

    def wanted(made: VerificationMade) -> bool:
        return verdict in (None, made.verdict)

    return page(case.verifications, cursor, limit, view, wanted=wanted, sort=sort)


@router.get("/{number}", openapi_extra=needs(Action.READ))
def read_verification(case_id: str, number: int, gateway: TheGateway) -> VerificationView:
    """One verification."""
    case = gateway.cases.case(case_id)
    return _view(number, gateway.verifications.content(case, number))


def _view(number: int, made: Verification) -> VerificationView:
    return VerificationView(**dict(made), number=number)
