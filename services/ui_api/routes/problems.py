"""RFC 9457 problem documents for everything that goes wrong, each with a stable `code`."""

import http
import logging
import math
from collections.abc import Mapping, Sequence
from typing import Final

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ConfigDict
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection
from starlette.responses import Response

from services.ui_api.handlers.refusals import RefusalKind, Refused
from services.ui_api.routes.invalid_request import wrongs_of
from services.ui_api.routes.route_index import RouteIndex
from shared.errors import BusError, DistalockError, InputError, NoReply, RecordUnavailable
from shared.messages.base import MessageInvalid

PROBLEM_JSON = "application/problem+json"

_log = logging.getLogger("distalock.ui_api")
# A request may quote itself in what is wrong with it.
_LONGEST_LOGGED: Final = 300
_STATUS_OF_KIND: Mapping[RefusalKind, int] = {
    RefusalKind.MALFORMED: 400,
    RefusalKind.UNAUTHENTICATED: 401,
    RefusalKind.FORBIDDEN: 403,
    RefusalKind.LOCKED: 429,
    RefusalKind.UNKNOWN: 404,
    RefusalKind.CONFLICT: 409,
    RefusalKind.PRECONDITION_FAILED: 412,
    RefusalKind.MEDIA_TYPE: 415,
    RefusalKind.INVALID: 422,
    RefusalKind.PRECONDITION_MISSING: 428,
    RefusalKind.UNAVAILABLE: 503,
    RefusalKind.NO_REPLY: 504,
}
_CODE_OF_STATUS: Mapping[int, str] = {
    404: "not_found",
    405: "method_not_allowed",
    408: "body_too_slow",
    413: "body_too_large",
}
# A missing header has another code than a wrong body, because the remedy is another one.
_MISSING_HEADERS: Mapping[str, tuple[int, str, str]] = {
    "idempotency-key": (
        400,
        "idempotency_key_missing",
        "the header Idempotency-Key is missing; send a new random key with every new action, the same with a repeat",
    ),
    "if-match": (
        428,
        "precondition_required",
        "the header If-Match is missing; send the ETag that was read: a plan's to approve it, a case's to change it",
    ),
}


class Place(BaseModel):
    """One thing that is wrong with a request, and where."""

    model_config = ConfigDict(extra="forbid")

    place: str
    message: str


class Problem(BaseModel):
    """RFC 9457 problem document."""

    model_config = ConfigDict(extra="forbid")

    type: str
    title: str
    status: int
    detail: str
    code: str
    instance: str
    errors: list[Place] | None = None
    checks: list[dict[str, str | bool]] | None = None
    current: dict[str, object] | None = None


def problem(status: int, code: str, detail: str, instance: str, errors: Sequence[Place] = ()) -> Problem:
    """A problem document; the title is the status's own phrase."""
    return Problem(
        type=f"urn:distalock:problem:{code}",
        title=http.HTTPStatus(status).phrase,
        status=status,
        detail=detail,
        code=code,
        instance=instance,
        errors=list(errors) or None,
    )


def problem_response(document: Problem, headers: Mapping[str, str] | None = None) -> Response:
    """A problem document as an answer."""
    content = document.model_dump_json(exclude_none=True)
    return Response(content, document.status, dict(headers or {}), media_type=PROBLEM_JSON)


def problem_of(error: DistalockError, instance: str) -> Problem:
    """The problem document of an error that was raised on purpose."""
    document = problem(_status_of(error), error.code, str(error), instance)
    if not isinstance(error, Refused) or error.current is None:
        return document
    return document.model_copy(update={"current": dict(error.current)})


def add_problem_handlers(app: FastAPI) -> None:
    """Answer every error of the application with a problem document."""
    app.add_exception_handler(DistalockError, _on_distalock_error)
    app.add_exception_handler(RequestValidationError, _on_invalid_request)
    app.add_exception_handler(HTTPException, _on_http_exception)
    app.add_exception_handler(Exception, _on_fault)


def _status_of(error: DistalockError) -> int:
    match error:
        case Refused():
            return _STATUS_OF_KIND[error.kind]
        case MessageInvalid():
            return 502  # another service said something that is not a message; the client is not to blame
        case InputError():
            return 422
        case NoReply():
            return 504
        case BusError() | RecordUnavailable():
            return 503
        case _:
            return 500


def sender_of(request: HTTPConnection) -> str:
    """Address of who sent a request."""
    return request.client.host if request.client else "unknown"


def log_refusal(document: Problem, sender: str) -> None:
    """What a client did wrong goes to the log, so that attempts can be found there."""
    if document.status < http.HTTPStatus.INTERNAL_SERVER_ERROR:
        _log.warning("request refused: %s: %s (from %s)", document.code, document.detail[:_LONGEST_LOGGED], sender)


def _refusal(request: Request, document: Problem, headers: Mapping[str, str] | None = None) -> Response:
    log_refusal(document, sender_of(request))
    return problem_response(document, headers)


async def _on_distalock_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, DistalockError)
    return _refusal(request, problem_of(error, request.url.path), headers_of(error))


def headers_of(error: DistalockError) -> dict[str, str]:
    """What goes with an error beside its document."""
    if not isinstance(error, Refused):
        return {}
    if error.etag is not None:
        return {"etag": error.etag}
    asked = {"www-authenticate": "Bearer"} if error.kind is RefusalKind.UNAUTHENTICATED else {}
    return asked if error.retry_after_s is None else {**asked, "retry-after": str(math.ceil(error.retry_after_s))}


async def _on_invalid_request(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    places = [Place(place=wrong.place, message=wrong.message) for wrong in wrongs_of(error.errors())]
    for name, (status, code, detail) in _MISSING_HEADERS.items():
        if any(
            e["type"] == "missing" and [str(p).lower() for p in e["loc"]] == ["header", name] for e in error.errors()
        ):
            return _refusal(request, problem(status, code, detail, request.url.path))
    more = f" (and {len(places) - 1} more)" if len(places) > 1 else ""
    detail = f"{places[0].message}{more}"
    return _refusal(request, problem(422, "request_invalid", detail, request.url.path, places))


async def _on_http_exception(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    code = _CODE_OF_STATUS.get(error.status_code, "request_refused")
    detail = f"{request.method} {request.url.path}: {error.detail}"
    headers = dict(error.headers or {})
    if error.status_code == http.HTTPStatus.METHOD_NOT_ALLOWED:
        routes: RouteIndex = request.app.state.routes
        methods = ", ".join(routes.methods_of(request.scope["path"])) or headers.get("allow", "GET")
        headers, detail = {**headers, "Allow": methods}, f"{request.url.path} has no {request.method}; it has {methods}"
    return _refusal(request, problem(error.status_code, code, detail, request.url.path), headers)


async def _on_fault(request: Request, error: Exception) -> Response:
    _log.error("fault in %s %s", request.method, request.url.path, exc_info=error)
    detail = "the gateway failed while it handled the request; its log has the cause"
    return problem_response(problem(500, "internal_error", detail, request.url.path))
