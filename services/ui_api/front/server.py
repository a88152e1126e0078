"""The public port, on an event loop with nothing else in it, on a thread of its own: signals are the main thread's."""

import asyncio
import socket
import ssl
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from services.ui_api.front.application import ApplicationLink
from services.ui_api.front.client_stream import ClientStream
from services.ui_api.front.connection import Connection, FrontParts
from services.ui_api.link_messages import FrontFigures
from shared.runtime.impairments import nearly_out_of_handles, nearly_out_of_memory
from shared.threads import report_error, supervised_thread

# As many are accepted at a time, before those that are idle make room, and before a stop on a connection that is there
# has its turn: 64 took 6 to 17 ms.
_ACCEPTED_AT_ONCE: Final = 8
_BACKLOG: Final = 1024
_HANDSHAKE_WITHIN_S: Final = 5.0
_FIGURES_EVERY_S: Final = 1.0
_LEAVE_WITHIN_S: Final = 2.0


class FrontServer:
    """Serves until `end`. With `tls`, TLS ends here, and `parts.scheme` is ``https``."""

    def __init__(self, parts: FrontParts, link: ApplicationLink, tls: ssl.SSLContext | None = None) -> None:
        self._parts, self._link, self._tls = parts, link, tls
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ended = asyncio.Event()
        self._connections: set[asyncio.Task[None]] = set()
        self._ready = threading.Event()

    def run(self, listening: socket.socket, line: socket.socket) -> None:
        """Serve; blocks. What ends one of the loop's helpers is raised."""
        try:
            asyncio.run(self._serve(listening, line))
        except ExceptionGroup as group:
            raise group.exceptions[0] from group

    def wait_until_ready(self) -> None:
        """Wait until connections are taken."""
        self._ready.wait()

    def end(self) -> None:
        """End all connections and the loop, from any thread."""
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._ended.set)

    async def _serve(self, listening: socket.socket, line: socket.socket) -> None:
        self._loop = asyncio.get_running_loop()
        async with asyncio.TaskGroup() as group:  # what one of them raises ends all, and the thread with a fault
            helpers = [group.create_task(self._link.run(line)), group.create_task(self._report_figures())]
            async with await self._loop.create_server(
                lambda: ClientStream(self._on_connection, self._parts.reads_within_s),
                sock=listening,
                backlog=_ACCEPTED_AT_ONCE,
                ssl=self._tls,
                ssl_handshake_timeout=None if self._tls is None else _HANDSHAKE_WITHIN_S,
            ):
                listening.listen(_BACKLOG)  # who waits to be accepted; the figure above is how many are at a time
                self._ready.set()
                await self._ended.wait()
            for task in (*helpers, *self._connections):
                task.cancel()
            await asyncio.gather(*self._connections, return_exceptions=True)
            self._parts.application.close()
            await asyncio.sleep(0.0)  # transports close with the loop's next turn

    def _on_connection(self, stream: ClientStream) -> None:
        task = asyncio.ensure_future(self._serve_connection(stream))
        self._connections.add(task)
        task.add_done_callback(self._connections.discard)

    async def _serve_connection(self, stream: ClientStream) -> None:
        try:
            await Connection(self._parts, stream).serve()
        except asyncio.CancelledError:
            return  # the front ends
        except Exception as error:  # noqa: BLE001 - the border of a task: one connection must not end the others
            report_error("a connection of the front", error)

    async def _report_figures(self) -> None:
        admission = self._parts.admission
        while True:
            self._link.tell(
                FrontFigures(
                    connections=admission.connections,
                    relays=admission.relays,
                    streams=admission.streams,
                    stops=len(self._parts.stops),
                    closed_idle=admission.closed_idle,
                    refused=admission.refused,
                    lacking=nearly_out_of_handles() or nearly_out_of_memory(),
                )
            )
            await asyncio.sleep(_FIGURES_EVERY_S)


@contextmanager
def serving_front(server: FrontServer, listening: socket.socket, line: socket.socket) -> Iterator[None]:
    """Serve for as long as the context lasts."""
    thread = supervised_thread("front", lambda: server.run(listening, line))
    thread.start()
    try:
        yield
    finally:
        server.end()
        thread.join(_LEAVE_WITHIN_S)
