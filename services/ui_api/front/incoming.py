"""What a client sends: one request after another, the body of the one under way, and what comes ahead of its turn."""

from collections.abc import Callable, Iterator
from typing import Final

import h11

from services.ui_api.front.client_stream import ClientStream
from services.ui_api.front.heads import RequestHead, Sender

# Chosen: several times what a browser with all its cookies sends (decision 22).
_MOST_HEAD_BYTES: Final = 32 * 1024
# Consoles ask for the same thing again and again, in the same words. Chosen: more than a console's head, and so little
# that thousands of connections may remember one.
_MOST_KNOWN_BYTES: Final = 2 * 1024
# Chosen: what comes ahead is looked through for a stop, between two turns of the loop.
_MOST_LOOKED_AT: Final = 8


class Incoming:
    """Reads one connection.

    Parameters
    ----------
    on_head_begun
        Called when a request has begun to come and is not whole.
    on_ahead
        Called when more has come after a request that is whole.
    """

    def __init__(
        self, stream: ClientStream, sender: Sender, on_head_begun: Callable[[], None], on_ahead: Callable[[], None]
    ) -> None:
        self._stream, self._sender = stream, sender
        self._on_head_begun, self._on_ahead = on_head_begun, on_ahead
        self._parser: h11.Connection | None = None
        self._ahead = b""
        self._known: tuple[bytes, RequestHead] | None = None

    async def next_head(self) -> RequestHead | None:
        """The head of the next request; None when the client has left. Raises `h11.RemoteProtocolError`."""
        content, self._ahead = self._ahead or await self._stream.read(), b""
        if self._known is not None and content == self._known[0]:
            return self._known[1]
        if not content:
            return None
        parser = self._parser = _parser(content)
        event, is_in_one_piece = parser.next_event(), True
        while event is h11.NEED_DATA:
            self._on_head_begun()
            more, is_in_one_piece = await self._stream.read(), False
            if not more:
                return None
            parser.receive_data(more)
            event = parser.next_event()
        if not isinstance(event, h11.Request):
            return None
        head = RequestHead(event, self._sender)
        if not head.states_length:
            parser.next_event()  # the end of a request that has no body
            self._take_end(parser)
            if is_in_one_piece and not self._ahead and len(content) <= _MOST_KNOWN_BYTES:
                self._known = content, head
        return head

    @property
    def is_whole(self) -> bool:
        """Whether the request under way has come to its end."""
        return self._parser is None

    @property
    def ahead(self) -> bytes:
        """What has come after the request under way; nothing as long as that is not whole."""
        return self._ahead + self._stream.waiting if self.is_whole else b""

    @property
    def client_waits_to_go_on(self) -> bool:
        """Whether the client sends its body only after `100 Continue`."""
        return self._parser is not None and self._parser.they_are_waiting_for_100_continue

    def body_pieces(self) -> Iterator[bytes]:
        """What has come of the body and was not taken yet; raises `h11.RemoteProtocolError`."""
        while self._parser is not None:
            event = self._parser.next_event()
            if isinstance(event, h11.Data):
                yield bytes(event.data)
            elif isinstance(event, h11.EndOfMessage):
                self._take_end(self._parser)
            else:
                return

    async def receive_body(self) -> bool:
        """Wait for more of the body; False when the client has left."""
        content = await self._stream.read()
        if content and self._parser is not None:
            self._parser.receive_data(content)
        return bool(content)

    async def receive_raw(self) -> bytes:
        """After an upgrade: what the client sends; empty at the end."""
        content, self._ahead = self._ahead, b""
        return content or await self._stream.read()

    def requests_ahead(self) -> Iterator[RequestHead]:
        """Requests without a body that have come ahead of their turn, as far as they are looked at."""
        content = self.ahead
        for _ in range(_MOST_LOOKED_AT):
            if not content:
                return
            parser = _parser(content)
            try:
                event = parser.next_event()
                if not isinstance(event, h11.Request):
                    return
                yield RequestHead(event, self._sender)
                if not isinstance(parser.next_event(), h11.EndOfMessage):
                    return
            except h11.RemoteProtocolError:
                return  # it is answered when it is due
            content = parser.trailing_data[0]

    def _take_end(self, parser: h11.Connection) -> None:
        """Nothing more comes of this request; what does is the next one's."""
        self._ahead, self._parser = parser.trailing_data[0], None
        if self._ahead:
            self._on_ahead()


def _parser(content: bytes) -> h11.Connection:
    parser = h11.Connection(h11.SERVER, max_incomplete_event_size=_MOST_HEAD_BYTES)
    parser.receive_data(content)
    return parser
