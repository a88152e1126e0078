"""Whoever acts goes before whoever watches: while a request that changes something is worked on, nothing is streamed.

Fifty viewers of thirty pictures a second keep the application busy, and a motion would wait behind them. A picture that
is not sent is replaced by the next one; events come a moment later. The command that follows from a request goes on
counting until the robot has answered (`CommandHandler`).
"""

from typing import Final

from starlette.types import ASGIApp, Receive, Scope, Send

from services.ui_api.handlers.acting import Acting

_ONLY_READS: Final = frozenset(("GET", "HEAD", "OPTIONS"))


class ActingFirst:
    """Middleware: counts requests that act."""

    def __init__(self, app: ASGIApp, acting: Acting) -> None:
        self._app, self._acting = app, acting

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Count it while it is worked on."""
        if scope["type"] != "http" or scope["method"] in _ONLY_READS:
            await self._app(scope, receive, send)
            return
        with self._acting.acting():
            await self._app(scope, receive, send)
