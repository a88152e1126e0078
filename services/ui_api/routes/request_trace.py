"""Every request is a trace: the caller's (`traceparent`), or a new one; the answer names it (`traceresponse`)."""

import re
from typing import Final

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from shared.tracing import TRACEPARENT, new_trace_id, trace_id_of, traced, traceparent_of

_ANSWERED: Final = b"traceresponse"
_CASE: Final = re.compile(r"/api/v1/cases/([A-Za-z0-9_-]{1,64})(/|$)")


class RequestTrace:
    """Middleware: log lines made while a request is worked on name its trace, and its case where its path does."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Bind the trace, pass on."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        trace_id = trace_id_of(Headers(scope=scope).get(TRACEPARENT, "")) or new_trace_id()
        case = _CASE.match(scope["path"])
        with traced(trace_id, **({"case": case[1]} if case else {})):
            answer = (_ANSWERED, traceparent_of(trace_id).encode("ascii"))

            async def naming(message: Message) -> None:
                if message["type"] == "http.response.start":
                    message["headers"] = [*message.get("headers", ()), answer]
                await send(message)

            await self._app(scope, receive, naming)
