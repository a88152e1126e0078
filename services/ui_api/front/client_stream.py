"""A client's connection as the front has it: what it has sent waits here until it is read, and both ends are noticed.

A stream of asyncio would do the same, but tells nobody of what comes while an answer is under way: a second task would
have to wait for that beside each answer. Here those two ends call.
"""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

# Chosen: what a client may send ahead before the front takes no more of it (decision 22).
_MOST_WAITING_BYTES: Final = 64 * 1024
# Chosen: somebody who reads a picture over a bad line reads something in it; who reads nothing holds one of the places
# of requests under way, of which there are some hundreds.
READS_WITHIN_S: Final = 30.0


class ClientStream(asyncio.Protocol):
    """One connection. One task reads, one writes.

    Parameters
    ----------
    on_connection
        Called once it is there.
    reads_within_s
        A client that reads nothing for so long while an answer waits for it has its connection ended.

    Attributes
    ----------
    transport
        From then on.
    """

    transport: asyncio.Transport

    def __init__(self, on_connection: Callable[["ClientStream"], None], reads_within_s: float = READS_WITHIN_S) -> None:
        self._on_connection, self._reads_within_s = on_connection, reads_within_s
        self._on_more: Callable[[], None] = _nothing
        self._on_end: Callable[[], None] = _nothing
        self._waiting = b""
        self._ended = self._lost = self._is_paused = False
        self._reader: asyncio.Future[None] | None = None
        self._writer: asyncio.Future[None] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The client is there."""
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        self._on_connection(self)

    def data_received(self, data: bytes) -> None:
        """More of it."""
        self._waiting = self._waiting + data if self._waiting else data
        if len(self._waiting) > _MOST_WAITING_BYTES:
            self.transport.pause_reading()
        _wake(self._reader)
        self._on_more()

    def eof_received(self) -> bool:
        """The client sends no more; what it has asked for it may get all the same, where TLS allows that."""
        self._end()
        return self.transport.get_extra_info("sslcontext") is None

    def connection_lost(self, exc: Exception | None) -> None:
        """The client has gone, or the connection was ended here."""
        del exc
        self._lost = True
        self._end()
        _wake(self._writer)

    def pause_writing(self) -> None:
        """The client reads slowly."""
        self._is_paused = True

    def resume_writing(self) -> None:
        """The client has read."""
        self._is_paused = False
        _wake(self._writer)

    @property
    def waiting(self) -> bytes:
        """What was sent and not read yet."""
        return self._waiting

    async def read(self) -> bytes:
        """All that was sent and not read yet, once there is something; empty at the end."""
        while not (self._waiting or self._ended):
            self._reader = asyncio.get_running_loop().create_future()
            try:
                await self._reader
            finally:
                self._reader = None
        content, self._waiting = self._waiting, b""
        if len(content) > _MOST_WAITING_BYTES and not self._lost:
            self.transport.resume_reading()
        return content

    def write(self, content: bytes) -> None:
        """Send."""
        self.transport.write(content)

    async def drain(self) -> None:
        """Wait until the client has read enough; raises `ConnectionResetError` when it has gone, or reads nothing."""
        while self._is_paused and not self._lost:
            self._writer = asyncio.get_running_loop().create_future()
            try:
                async with asyncio.timeout(self._reads_within_s):
                    await self._writer
            except TimeoutError:
                self.abort()
                raise ConnectionResetError(f"the client has read nothing for {self._reads_within_s:g} s") from None
            finally:
                self._writer = None
        if self._lost:
            raise ConnectionResetError("the client has gone")

    @contextmanager
    def watched(self, on_more: Callable[[], None], on_end: Callable[[], None]) -> Iterator[None]:
        """Call where more comes, or the client leaves, for as long as the context lasts; at once where it has left."""
        self._on_more, self._on_end = on_more, on_end
        if self._ended:
            on_end()
        try:
            yield
        finally:
            self._on_more = self._on_end = _nothing

    def end_writing(self) -> None:
        """Tell the client that no more comes; under TLS that cannot be told without ending both ways."""
        if self.transport.get_extra_info("sslcontext") is None:
            self.transport.write_eof()

    def close(self) -> None:
        """End the connection when what was written has gone out."""
        self.transport.close()

    def abort(self) -> None:
        """End the connection now."""
        self.transport.abort()

    def _end(self) -> None:
        if not self._ended:
            self._ended = True
            _wake(self._reader)
            self._on_end()


def _nothing() -> None:
    pass


def _wake(waiter: "asyncio.Future[None] | None") -> None:
    if waiter is not None and not waiter.done():
        waiter.set_result(None)
