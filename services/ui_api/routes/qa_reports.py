"""`/cases/{id}/qa-reports`: ring and C-arm over the images of a case."""

from fastapi import Request, Response

from services.ui_api.core.event_data import QaReported
from services.ui_api.core.roles import Action
from services.ui_api.record.unit_of_work import Answer, UnitOfWork
from services.ui_api.routes.access import TheGateway, TheIdempotency
from services.ui_api.routes.bodies import QaBody
from services.ui_api.routes.guards import needs
from services.ui_api.routes.idempotency import IdempotencyKey, json_answer, keyed, problem_answer
from services.ui_api.routes.pages import Cursor, Limit, Page, page
from services.ui_api.routes.preconditions import CaseMatch, case_etag_after, matched_case
from services.ui_api.routes.problems import problem
from services.ui_api.routes.routers import resource_router
from shared.messages.qa import QaReply, QaReport

router = resource_router("/cases/{case_id}/qa-reports", tag="quality control")
# The page brings its style and pictures along and needs no script: nothing else may run or load.
_SAFE = {
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'"
}


class QaReportView(QaReport):
    """What `distalock qa` writes, with its number in the case."""

    number: int


@router.post("", status_code=201, response_model=QaReportView, openapi_extra=needs(Action.REPORT_QUALITY))
def make_qa_report(
    case_id: str,
    request: Request,
    body: QaBody,
    key: IdempotencyKey,
    if_match: CaseMatch,
    gateway: TheGateway,
    idempotency: TheIdempotency,
) -> Response:
    """Examine ring and C-arm over images of the case, best at one angle of the C-arm and without a patient."""
    images = tuple(body.images)

    def ask() -> QaReply:
        return gateway.quality.ask(gateway.quality.request(matched_case(gateway, case_id, if_match), images))

    def act(unit: UnitOfWork, reply: QaReply) -> Answer:
        if reply.report is None:
            return problem_answer(problem(409, reply.code or "no_report", reply.message, request.url.path))
        number = gateway.quality.keep(unit, case_id, images, reply.report, reply.page)
        location, newest = f"{request.url.path}/{number}", case_etag_after(gateway, case_id, unit)
        return json_answer(201, _view(number, reply.report), location=location, case_etag=newest)

    return idempotency.once_after(keyed(request, key, body), ask, act)


@router.get("", openapi_extra=needs(Action.READ))
def list_qa_reports(case_id: str, gateway: TheGateway, cursor: Cursor = None, limit: Limit = 50) -> Page[QaReportView]:
    """The quality reports of a case, the oldest first."""
    case = gateway.cases.case(case_id)

    def view(made: QaReported) -> QaReportView:
        return _view(made.number, gateway.quality.content(case, made.number))

    return page(case.qa_reports, cursor, limit, view)


@router.get(
    "/{number}.html",
    response_class=Response,
    responses={200: {"content": {"text/html": {}}}},
    openapi_extra=needs(Action.READ),
)
def read_qa_page(case_id: str, number: int, gateway: TheGateway) -> Response:
    """A report as a page with pictures."""
    content = gateway.quality.page(gateway.cases.case(case_id), number)
    return Response(content, media_type="text/html; charset=utf-8", headers=_SAFE)


@router.get("/{number}", openapi_extra=needs(Action.READ))
def read_qa_report(case_id: str, number: int, gateway: TheGateway) -> QaReportView:
    """One report."""
    return _view(number, gateway.quality.content(gateway.cases.case(case_id), number))


def _view(number: int, made: QaReport) -> QaReportView:
    return QaReportView(**dict(made), number=number)
