"""Refuses bodies that are larger than anything this gateway is meant to read, before they fill its memory."""

from fastapi import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LARGEST_BODY_BYTES = 4 * 1024 * 1024


class BodyLimitMiddleware:
    """Counts a body while it is read. Who reads none, such as stop, is never refused for it."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on; reading past the limit raises the refusal where the body is read."""
        received_bytes = 0

        async def counting() -> Message:
            nonlocal received_bytes
            message = await receive()
            received_bytes += len(message.get("body", b""))
            if received_bytes > LARGEST_BODY_BYTES:
                limit = f"the limit is {LARGEST_BODY_BYTES} bytes"
                raise HTTPException(413, f"the body has more than {received_bytes - 1} bytes, {limit}; send less")
            return message

        await self._app(scope, counting if scope["type"] == "http" else receive, send)
