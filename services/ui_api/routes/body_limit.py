"""Refuses bodies that are larger than anything this gateway is meant to read, or that trickle in."""

import asyncio
from typing import Final

from fastapi import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

# Chosen: several times the largest part file; images do not come by this way.
LARGEST_BODY_BYTES: Final = 4 * 1024 * 1024
BODY_WITHIN_S: Final = 10.0
"""For a whole body: a part file of 200 kB needs 20 kB/s."""


class BodyLimitMiddleware:
    """Counts a body while it is read, and its time. Who reads none, such as stop, is never refused for it."""

    def __init__(self, app: ASGIApp, within_s: float = BODY_WITHIN_S) -> None:
        self._app, self._within_s = app, within_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on; reading past a limit raises the refusal where the body is read."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        received_bytes, complete = 0, False
        deadline_s = asyncio.get_running_loop().time() + self._within_s

        async def counting() -> Message:
            nonlocal received_bytes, complete
            message = await (receive() if complete else self._in_time(receive, deadline_s, received_bytes))
            received_bytes += len(message.get("body", b""))
            # After its end a client is only waited for: whether it leaves.
            complete = complete or not message.get("more_body", False)
            if received_bytes > LARGEST_BODY_BYTES:
                limit = f"the limit is {LARGEST_BODY_BYTES} bytes"
                raise HTTPException(413, f"the body has more than {received_bytes - 1} bytes, {limit}; send less")
            return message

        await self._app(scope, counting, send)

    async def _in_time(self, receive: Receive, deadline_s: float, received_bytes: int) -> Message:
        try:
            async with asyncio.timeout_at(deadline_s):
                return await receive()
        except TimeoutError:
            raise HTTPException(
                408,
                f"{received_bytes} bytes of the body came within {self._within_s:g} s, and not its end; send it faster",
                {"Connection": "close"},
            ) from None
