"""The raw end of a connection that streams: what goes to fifty clients is made once, and written to each as it is."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any, Final

# In the scope's `extensions`: there where the server lends its connection to who streams.
EXTENSION: Final = "distalock.outlet"
# Chosen: as in the front (`client_stream`), somebody on a bad line reads something in it.
READS_WITHIN_S: Final = 30.0


class Outlet:
    """One client's connection. Belongs to its event loop.

    Attributes
    ----------
    on_change
        Called when all that was written has gone out, and when the connection has ended.
    """

    def __init__(self, transport: asyncio.Transport) -> None:
        self._transport = transport
        self._least_bytes, self._since_s = 0, 0.0
        self.on_change: Callable[[], None] = _nothing

    def lend(self, on_change: Callable[[], None]) -> None:
        """From now on somebody writes to it who wants to know when nothing waits any more."""
        self.on_change = on_change
        self._transport.set_write_buffer_limits(high=0)

    @property
    def is_closing(self) -> bool:
        """Whether nothing can be written any more."""
        return self._transport.is_closing()

    @property
    def backlog_bytes(self) -> int:
        """What the client has not read yet, beyond what the system holds for it."""
        return self._transport.get_write_buffer_size()

    def write(self, content: bytes) -> None:
        """Send; never waits. The content is not copied as long as the client keeps up."""
        self._transport.write(content)

    def abort(self) -> None:
        """End the connection now, whatever waits to go out."""
        self._transport.abort()

    def end_if_stuck(self, now_s: float) -> None:
        """End the connection of a client that has read nothing for long; to be asked now and then."""
        backlog_bytes = self.backlog_bytes
        if backlog_bytes == 0 or backlog_bytes != self._least_bytes:
            self._least_bytes, self._since_s = backlog_bytes, now_s
        elif now_s - self._since_s > READS_WITHIN_S:
            self.abort()


def outlet_of(scope: Mapping[str, Any]) -> Outlet:
    """The connection of a request."""
    outlet: Outlet = scope["extensions"][EXTENSION]
    return outlet


def _nothing() -> None:
    pass
