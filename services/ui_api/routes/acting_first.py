"""Whoever acts goes before whoever watches: while a request that changes something is worked on, no pictures are sent.

Fifty viewers of thirty pictures a second fill the application's loop, and a motion would wait behind them. A picture
that is not sent is replaced by the next one.
"""

import asyncio
from typing import Final

from starlette.types import ASGIApp, Receive, Scope, Send

_ONLY_READS: Final = frozenset(("GET", "HEAD", "OPTIONS"))
# Chosen: several times what a motion's request takes; one that waits for another service must not freeze the picture.
_PICTURES_WAIT_S: Final = 0.3


class Acting:
    """How many requests that act are worked on. For one event loop."""

    def __init__(self) -> None:
        self._count = 0
        self._nobody = asyncio.Event()
        self._nobody.set()

    def begin(self) -> None:
        """A request has come."""
        self._count += 1
        self._nobody.clear()

    def end(self) -> None:
        """It is answered."""
        self._count -= 1
        if self._count == 0:
            self._nobody.set()

    async def nobody(self) -> None:
        """Wait until nobody acts, for a moment at most."""
        if self._count:
            try:
                async with asyncio.timeout(_PICTURES_WAIT_S):
                    await self._nobody.wait()
            except TimeoutError:
                return


class ActingFirst:
    """Middleware: counts requests that act."""

    def __init__(self, app: ASGIApp, acting: Acting) -> None:
        self._app, self._acting = app, acting

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Count it while it is worked on."""
        if scope["type"] != "http" or scope["method"] in _ONLY_READS:
            await self._app(scope, receive, send)
            return
        self._acting.begin()
        try:
            await self._app(scope, receive, send)
        finally:
            self._acting.end()
