"""uvicorn's server for connections that the front has accepted and hands over: see `front.handover`."""

import asyncio
import socket
from typing import Final

import uvicorn

from shared.threads import report_error

# As the front sends at most: see `front.handover`.
_MOST_BYTES: Final = 64 * 1024


class HandedServer(uvicorn.Server):
    """Takes connections from a socket; they end with their answer.

    Attributes
    ----------
    streams
        How many of them are open.
    """

    def __init__(self, config: uvicorn.Config, handed_on: socket.socket) -> None:
        super().__init__(config)
        self._handed_on = handed_on
        self._transports: set[asyncio.Transport] = set()
        self._adopting: set[asyncio.Task[None]] = set()
        self.streams = 0

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to take connections."""
        await super().startup(sockets)
        self._handed_on.setblocking(False)  # noqa: FBT003 - the standard library's signature
        asyncio.get_running_loop().add_reader(self._handed_on, self._take)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Take no more."""
        asyncio.get_running_loop().remove_reader(self._handed_on)
        await super().shutdown(sockets)

    async def on_tick(self, counter: int) -> bool:
        """Ten times a second: count those that are still open."""
        self._transports = {transport for transport in self._transports if not transport.is_closing()}
        self.streams = len(self._transports)
        return await super().on_tick(counter)

    def _take(self) -> None:
        try:
            content, handles, _, _ = socket.recv_fds(self._handed_on, _MOST_BYTES, 1)
        except BlockingIOError:
            return
        except OSError as error:
            report_error("a connection from the front", error)
            return
        if not content:  # the front has ended
            asyncio.get_running_loop().remove_reader(self._handed_on)
        for handle in handles:
            task = asyncio.get_running_loop().create_task(self._adopt(socket.socket(fileno=handle), content))
            self._adopting.add(task)
            task.add_done_callback(self._adopting.discard)

    async def _adopt(self, connection: socket.socket, content: bytes) -> None:
        """Serve it from what the front has read of it on."""
        try:
            connection.setblocking(False)  # noqa: FBT003 - the standard library's signature
            transport, protocol = await asyncio.get_running_loop().connect_accepted_socket(self._protocol, connection)
            self._transports.add(transport)
            protocol.data_received(content)
        except Exception as error:  # noqa: BLE001 - the border of a task: one connection must not end the others
            report_error("a connection from the front", error)

    def _protocol(self) -> asyncio.Protocol:
        protocol: asyncio.Protocol = self.config.http_protocol_class(  # type: ignore[call-arg]
            config=self.config, server_state=self.server_state, app_state=self.lifespan.state
        )
        return protocol
