"""The answers that the front gives itself. What they hold is fixed by the OpenAPI file, which a test compares."""

import http
import json
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from services.ui_api.core.request_policy import safe_headers
from services.ui_api.handlers.stop import StopOutcome

_PROBLEM_JSON: Final = "application/problem+json"


@dataclass(frozen=True, slots=True)
class Asked:
    """What of a request its answer depends on."""

    path: str
    scheme: str
    keeps_open: bool


def stop_answer(outcome: StopOutcome, asked: Asked, *, recorded: bool) -> bytes:
    """What came of a stop."""
    if not outcome.confirmed:
        return problem_answer(504, "stop_not_confirmed", outcome.message, asked)
    state = None if outcome.state is None else str(outcome.state)
    view = {"confirmed": True, "state": state, "detail": outcome.message, "recorded": recorded}
    return _answer(200, "application/json", view, {}, asked)


def problem_answer(
    status: int, code: str, detail: str, asked: Asked, headers: Mapping[str, str] = MappingProxyType({})
) -> bytes:
    """A problem document (RFC 9457)."""
    document = {
        "type": f"urn:distalock:problem:{code}",
        "title": http.HTTPStatus(status).phrase,
        "status": status,
        "detail": detail,
        "code": code,
        "instance": asked.path,
    }
    return _answer(status, _PROBLEM_JSON, document, headers, asked)


def _answer(
    status: int, media_type: str, content: Mapping[str, object], headers: Mapping[str, str], asked: Asked
) -> bytes:
    body = json.dumps(content, ensure_ascii=False, separators=(",", ":")).encode()
    fields = {
        "content-type": media_type,
        "content-length": str(len(body)),
        **safe_headers(asked.scheme),
        **headers,
        **({} if asked.keeps_open else {"connection": "close"}),
    }
    lines = [
        f"HTTP/1.1 {status} {http.HTTPStatus(status).phrase}",
        *(f"{name}: {value}" for name, value in fields.items()),
    ]
    return "\r\n".join(lines).encode() + b"\r\n\r\n" + body
