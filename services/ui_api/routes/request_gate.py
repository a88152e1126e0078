"""The first to see a request: refuses what a foreign page sent, and puts security headers on every answer."""

import logging
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Final

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
_NAMED: Final = (b"host", b"origin", b"sec-fetch-site")
_FRAMING: Final = frozenset((b"content-length", b"transfer-encoding"))
_ENCRYPTED: Final = frozenset(("https", "wss"))
_CONNECTION: Final = b"connection"
_CLOSES: Final = (_CONNECTION, b"close")
# http, https, ws and wss, and room.
_SCHEMES: Final = 8
Fields = Sequence[tuple[bytes, bytes]]


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
            cors = _fields(cors_headers(facts.origin, self._cors_origins))
            send = _with_headers(send, (*_safe(scope["scheme"]), *cors))
            app = Response(status_code=204, headers=preflight) if preflight else self._app
            await app(scope, receive, send)
            return
        safely = _with_headers(send, (*_safe(scope["scheme"]), _CLOSES))
        if scope["path"] == _NEVER_REFUSED:
            await self._app(scope, receive, safely)
            return
        _log.warning("request refused: %s: %s (from %s)", refused.code, refused.message, _sender(scope))
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": str(refused.code)})
            return
        await _refusal(refused, scope)(scope, receive, safely)


def _facts(scope: Scope) -> RequestFacts:
    websocket = scope["type"] == "websocket"
    named, framings = dict.fromkeys(_NAMED, None), 0
    for name, value in scope["headers"]:
        framings += name in _FRAMING
        if name in named and named[name] is None:
            named[name] = value.decode("latin-1")
    return RequestFacts(
        method="WEBSOCKET" if websocket else scope["method"],
        scheme="https" if _is_encrypted(scope) else "http",
        host=named[b"host"] or "",
        origin=named[b"origin"],
        fetch_site=named[b"sec-fetch-site"],
        framings=framings,
    )


def _refusal(refused: RefusedRequest, scope: Scope) -> Response:
    return problem_response(problem(_STATUS[refused.code], refused.code, refused.message, scope["path"]))


def _is_encrypted(scope: Scope) -> bool:
    return scope["scheme"] in _ENCRYPTED


def _with_headers(send: Send, added: Fields) -> Send:
    """Add headers to the answer; what a route has set itself stays.

    An answer that states no length ends with its connection: by that the front sees its end (`front.relay`).
    """

    async def adding(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers: Fields = message.get("headers", ())
            present = {name for name, _ in headers}
            headers = [*headers, *(field for field in added if field[0] not in present)]
            if b"content-length" not in present and message["status"] not in _NO_BODY:
                headers = [*(field for field in headers if field[0] != _CONNECTION), _CLOSES]
            message["headers"] = headers
        await send(message)

    return adding


@lru_cache(_SCHEMES)
def _safe(scheme: str) -> Fields:
    return _fields(safe_headers("https" if scheme in _ENCRYPTED else "http"))


def _fields(headers: Mapping[str, str]) -> Fields:
    return tuple((name.lower().encode("latin-1"), value.encode("latin-1")) for name, value in headers.items())


def _sender(scope: Scope) -> str:
    client = scope.get("client")
    return client[0] if client else "unknown"
