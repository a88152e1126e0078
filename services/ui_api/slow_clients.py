"""Connections that take too long over the head of a request are closed: nobody holds them all for nothing."""

import asyncio
import logging
from typing import Final

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD_WITHIN_S: Final = 5.0
_log = logging.getLogger("distalock.ui_api")


class HeadDeadlineProtocol(H11Protocol):
    """uvicorn's strict HTTP/1.1 (h11), with a deadline for each request's head; `body_limit` has that of the body."""

    head_within_s = HEAD_WITHIN_S
    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as uvicorn's
        """The first head begins now."""
        super().connection_made(transport)
        self._begin()

    def data_received(self, data: bytes) -> None:
        """A head has ended when h11 has left its idle state; more than the end of the last request begins the next."""
        super().data_received(data)
        if self.conn.their_state is not h11.IDLE:
            self._end()
        elif self._deadline is None:
            self._begin()

    def connection_lost(self, exc: Exception | None) -> None:
        """Nobody is waited for any more."""
        self._end()
        super().connection_lost(exc)

    def _begin(self) -> None:
        self._deadline = self.loop.call_later(self.head_within_s, self._close)

    def _end(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _close(self) -> None:
        sender = self.client[0] if self.client else "unknown"
        _log.warning("head_too_slow: no whole request within %g s (from %s)", self.head_within_s, sender)
        self.transport.abort()
