"""The first to see a request: refuses what a foreign page sent, and puts security headers on every answer."""

import logging
from collections.abc import Mapping, Sequence
from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.ui_api.core.request_policy import (
    RefusedRequest,
    RequestFacts,
    RequestRefusal,
    cors_headers,
    preflight_headers,
    refused_request,
    safe_headers,
)
from services.ui_api.routes.guards import POLICY_VIOLATION
from services.ui_api.routes.problems import problem, problem_response

_log = logging.getLogger("distalock.ui_api")
_STATUS: Final = {
    RequestRefusal.HOST_NOT_ALLOWED: 421,
    RequestRefusal.CROSS_SITE_REQUEST: 403,
    RequestRefusal.AMBIGUOUS_LENGTH: 400,
}
# Whoever asks for a stop gets it: a stop that a foreign page sends disturbs, one that is refused hurts.
_NEVER_REFUSED: Final = "/api/v1/robot/stop"
_NO_BODY: Final = frozenset((204, 304))


class RequestGate:
    """Middleware around the whole application.

    Parameters
    ----------
    allowed_hosts
        Names under which this machine may be called, besides addresses and `localhost`.
    cors_origins
        Other origins whose pages may call this machine.
    """

    def __init__(self, app: ASGIApp, allowed_hosts: Sequence[str], cors_origins: Sequence[str] = ()) -> None:
        self._app, self._allowed_hosts, self._cors_origins = app, tuple(allowed_hosts), tuple(cors_origins)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse, or pass on with headers on the answer."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        facts = _facts(scope)
        refused = refused_request(facts, self._allowed_hosts, self._cors_origins)
        if refused is None:
            preflight = preflight_headers(facts.origin, self._cors_origins) if facts.method == "OPTIONS" else {}
            send = _with_headers(send, _safe(scope) | cors_headers(facts.origin, self._cors_origins))
            app = Response(status_code=204, headers=preflight) if preflight else self._app
            await app(scope, receive, send)
            return
        safely = _with_headers(send, _safe(scope) | {"connection": "close"})
        if scope["path"] == _NEVER_REFUSED:
            await self._app(scope, receive, safely)
            return
        _log.warning("request refused: %s: %s (from %s)", refused.code, refused.message, _sender(scope))
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": str(refused.code)})
            return
        await _refusal(refused, scope)(scope, receive, safely)


def _facts(scope: Scope) -> RequestFacts:
    headers = Headers(scope=scope)
    websocket = scope["type"] == "websocket"
    return RequestFacts(
        method="WEBSOCKET" if websocket else scope["method"],
        scheme="https" if _is_encrypted(scope) else "http",
        host=headers.get("host", ""),
        origin=headers.get("origin"),
        fetch_site=headers.get("sec-fetch-site"),
        framings=len(headers.getlist("content-length")) + len(headers.getlist("transfer-encoding")),
    )


def _refusal(refused: RefusedRequest, scope: Scope) -> Response:
    return problem_response(problem(_STATUS[refused.code], refused.code, refused.message, scope["path"]))


def _safe(scope: Scope) -> dict[str, str]:
    return safe_headers("https" if _is_encrypted(scope) else "http")


def _is_encrypted(scope: Scope) -> bool:
    return scope["scheme"] in ("https", "wss")


def _with_headers(send: Send, added: Mapping[str, str]) -> Send:
    """Add headers to the answer; what a route has set itself stays.

    An answer that states no length ends with its connection: by that the front sees its end (`front.relay`).
    """

    async def adding(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in added.items():
                headers.setdefault(name, value)
            if "content-length" not in headers and message["status"] not in _NO_BODY:
                headers["connection"] = "close"
        await send(message)

    return adding


def _sender(scope: Scope) -> str:
    client = scope.get("client")
    return client[0] if client else "unknown"
