"""The application's end of a connection with its front, for uvicorn's server: request after request."""

import asyncio
from typing import Any, Final, cast

import structlog
import uvicorn
from uvicorn.server import ServerState

from services.ui_api.inner.bodies import BodyOfLength, BodyReader, ChunkedBody
from services.ui_api.inner.exchange import Application, Exchange
from services.ui_api.inner.heads import HEAD_END, InnerHead
from services.ui_api.outlet import EXTENSION, Outlet

_log = structlog.stdlib.get_logger("distalock.ui_api")
# Twice what the front takes of a client's.
_MOST_HEAD_BYTES: Final = 64 * 1024


class InnerProtocol(asyncio.Protocol):
    """One connection. The front sends one request at a time on it, and a stream's connection has one only."""

    _transport: asyncio.Transport
    _outlet: Outlet

    def __init__(
        self,
        config: uvicorn.Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        self._config, self._server_state, self._app_state = config, server_state, app_state
        self._application = cast("Application", config.loaded_app)
        self._content = b""
        self._body: BodyReader | None = None
        self._exchange: Exchange | None = None
        self._known: InnerHead | None = None
        self._is_leaving = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The front is there."""
        assert isinstance(transport, asyncio.Transport)
        self._transport, self._outlet = transport, Outlet(transport)
        self._server_state.connections.add(cast("Any", self))

    def connection_lost(self, exc: Exception | None) -> None:
        """The front has ended it, or the client of a stream has left."""
        del exc
        self._server_state.connections.discard(cast("Any", self))
        if self._exchange is not None:
            self._exchange.disconnect()
        self._outlet.on_change()

    def data_received(self, data: bytes) -> None:
        """More of a request."""
        self._content = self._content + data if self._content else data
        try:
            self._go_on()
        except ValueError as error:
            _log.error("front_misunderstood", detail=str(error))
            self._transport.abort()

    def pause_writing(self) -> None:
        """What was written waits to go out."""
        if self._exchange is not None:
            self._exchange.pause()

    def resume_writing(self) -> None:
        """It has gone out."""
        if self._exchange is not None:
            self._exchange.resume()
        self._outlet.on_change()

    def shutdown(self) -> None:
        """The server ends: answer what is under way, and nothing new."""
        self._is_leaving = True
        if self._exchange is None:
            self._transport.close()

    def _go_on(self) -> None:
        """Take what has come: of the body under way, then the next request."""
        while True:
            if self._body is not None and not self._took_body(self._body):
                return
            if self._exchange is not None:
                if self._content:
                    self._transport.pause_reading()  # it asks for more before its time
                return
            if not self._content:
                return
            head, found, rest = self._content.partition(HEAD_END)
            if not found:
                if len(self._content) > _MOST_HEAD_BYTES:
                    raise ValueError(f"a head of more than {_MOST_HEAD_BYTES} bytes")
                return
            self._content = rest
            if self._begun(self._head_of(head + found)):
                return

    def _took_body(self, reader: BodyReader) -> bool:
        """Take what has come of the body; whether it has ended."""
        body, self._content = reader.take(self._content)
        if self._exchange is not None:
            self._exchange.take(body, ended=reader.ended)
            if self._exchange.is_full and not reader.ended:
                self._transport.pause_reading()
        if reader.ended:
            self._body = None
        return reader.ended

    def _head_of(self, content: bytes) -> InnerHead:
        """Consoles ask for the same thing again and again, in the same words."""
        if self._known is None or self._known.content != content:
            self._known = InnerHead.of(content)
        return self._known

    def _begun(self, head: InnerHead) -> bool:
        """Begin to answer; whether another protocol has taken over."""
        if head.is_websocket:
            self._upgrade(head)
            return True
        exchange = Exchange(head, self._transport, self._server_state.default_headers, self._on_answered)
        self._body = ChunkedBody() if head.length_bytes is None else BodyOfLength(head.length_bytes)
        self._exchange = exchange
        scope = head.scope({EXTENSION: self._outlet})
        task = asyncio.get_running_loop().create_task(exchange.run(self._application, scope))
        self._server_state.tasks.add(task)
        task.add_done_callback(self._server_state.tasks.discard)
        return False

    def _upgrade(self, head: InnerHead) -> None:
        """Let uvicorn's WebSocket take over."""
        assert self._config.ws_protocol_class is not None
        self._server_state.connections.discard(cast("Any", self))
        protocol = self._config.ws_protocol_class(  # type: ignore[call-arg]
            config=self._config, server_state=self._server_state, app_state=self._app_state
        )
        self._transport.set_protocol(protocol)
        protocol.connection_made(self._transport)
        protocol.data_received(head.content + self._content)

    def _on_answered(self) -> None:
        exchange, self._exchange = self._exchange, None
        self._server_state.total_requests += 1
        if self._is_leaving or exchange is None or not exchange.keeps_open:
            self._transport.close()
        else:
            self._transport.resume_reading()  # maybe there is the rest of a body that nobody wanted
            self._go_on()
