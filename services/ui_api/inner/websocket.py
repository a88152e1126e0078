"""uvicorn's WebSocket with its connection lent to who streams, and with the sender as the front saw it."""

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request

from services.ui_api.outlet import EXTENSION, Outlet


class InnerWebSocket(WebSocketsSansIOProtocol):
    """One viewer. uvicorn shakes hands, pings and closes; the messages themselves are written by `routes.live`."""

    _outlet: Outlet | None = None

    def handle_connect(self, event: Request) -> None:
        """Begin, as somebody whom the front names."""
        self.client = (event.headers.get("x-forwarded-for", "unknown"), 0)
        self.scheme = "wss" if event.headers.get("x-forwarded-proto") == "https" else "ws"
        super().handle_connect(event)
        if self.response.status_code == 101:
            self._outlet = Outlet(self.transport)
            self.scope["extensions"][EXTENSION] = self._outlet  # type: ignore[assignment]

    def resume_writing(self) -> None:
        """Everything has gone out."""
        super().resume_writing()
        self._tell()

    def connection_lost(self, exc: Exception | None) -> None:
        """The viewer has left."""
        super().connection_lost(exc)
        self._tell()

    def _tell(self) -> None:
        if self._outlet is not None:
            self._outlet.on_change()
