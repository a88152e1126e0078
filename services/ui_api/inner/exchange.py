"""One request and its answer, as ASGI has them."""

import asyncio
import http
from collections.abc import Awaitable, Callable, MutableMapping, Sequence
from functools import cache
from typing import Any, Final

import structlog

from services.ui_api.inner.heads import InnerHead
from shared.threads import report_error

_log = structlog.stdlib.get_logger("distalock.ui_api")

Message = MutableMapping[str, Any]
Application = Callable[
    [MutableMapping[str, Any], Callable[[], Awaitable[Message]], Callable[[Message], Awaitable[None]]], Awaitable[None]
]
_NO_BODY: Final = frozenset((204, 304))
_CLOSES: Final = (b"connection", b"close")
_FAULT: Final = b"the gateway failed while it handled the request; its log has the cause"
# Chosen: what comes of a body while its handler does something else (decision 22).
MOST_WAITING_BYTES: Final = 64 * 1024


class Exchange:
    """One request and its answer.

    The answer's head waits for the first piece of its body and goes out with it, in one piece. An answer ends by the
    length that it states, or with its connection.

    Attributes
    ----------
    answered
        Whether the answer is complete.
    keeps_open
        Whether the connection can take another request then.
    """

    def __init__(
        self,
        head: InnerHead,
        transport: asyncio.Transport,
        default_fields: Sequence[tuple[bytes, bytes]],
        on_answered: Callable[[], None],
    ) -> None:
        self._head, self._transport = head, transport
        self._default_fields, self._on_answered = default_fields, on_answered
        self._body, self._body_ended, self._body_told = bytearray(), False, False
        self._disconnected = False
        self._news: asyncio.Future[None] | None = None
        self._writable: asyncio.Future[None] | None = None
        self._waiting_head: bytes | None = None
        self._begun = False
        self._missing_bytes: int | None = None
        self.answered = False
        self.keeps_open = not head.is_last

    async def run(self, application: Application, scope: dict[str, Any]) -> None:
        """Have the application answer it; whatever it raises goes to the log, and costs the connection."""
        try:
            await application(scope, self.receive, self.send)
        except Exception as error:  # noqa: BLE001 - the border of a task: one request must not end the others
            if not self.answered:  # otherwise the framework has answered with a fault, and logged it
                report_error(f"{self._head.method} {self._head.path}", error)
        if self.answered or self._disconnected:
            return
        if self._begun:
            self._transport.close()
            return
        length = (b"content-length", b"%d" % len(_FAULT))
        await self.send({"type": "http.response.start", "status": 500, "headers": [length, _CLOSES]})
        await self.send({"type": "http.response.body", "body": _FAULT})

    def take(self, body: bytes, *, ended: bool) -> None:
        """More of the body has come."""
        self._body += body
        self._body_ended = ended
        _wake(self._news)

    @property
    def is_full(self) -> bool:
        """Whether so much of the body waits that no more should be read."""
        return len(self._body) > MOST_WAITING_BYTES

    def disconnect(self) -> None:
        """The client has left."""
        self._disconnected = True
        _wake(self._news)
        self.resume()

    def pause(self) -> None:
        """The client reads slowly."""
        if self._writable is None:
            self._writable = asyncio.get_running_loop().create_future()

    def resume(self) -> None:
        """The client has read."""
        _wake(self._writable)
        self._writable = None

    async def receive(self) -> Message:
        """The body piece by piece; then the end of the answer, or of the client."""
        while not (self._disconnected or self.answered):
            if self._body or (self._body_ended and not self._body_told):
                body, self._body = bytes(self._body), bytearray()
                self._body_told = self._body_ended
                self._transport.resume_reading()
                return {"type": "http.request", "body": body, "more_body": not self._body_ended}
            self._news = asyncio.get_running_loop().create_future()
            await self._news
        return {"type": "http.disconnect"}

    async def send(self, message: Message) -> None:
        """The answer's head, then its body."""
        if self._writable is not None:
            await asyncio.shield(self._writable)
        if self._disconnected or self.answered:
            return
        if message["type"] == "http.response.start":
            self._begin(message["status"], message.get("headers", ()))
            return
        self._write(message.get("body", b""))
        if not message.get("more_body", False):
            self._end()

    def _begin(self, status: int, fields: Sequence[tuple[bytes, bytes]]) -> None:
        fields = (*self._default_fields, *fields)
        if self._head.is_last and _CLOSES not in fields:
            fields = (*fields, _CLOSES)
        lines = [_status_line(status), *(b"%s: %s\r\n" % field for field in fields), b"\r\n"]
        self._waiting_head, self._begun = b"".join(lines), True
        named = dict(fields)
        length = named.get(b"content-length")
        if status in _NO_BODY or self._head.method == "HEAD":
            self._missing_bytes = 0
        elif length is not None:
            self._missing_bytes = int(length)
        self.keeps_open &= self._missing_bytes is not None and named.get(b"connection", b"").lower() != b"close"

    def _write(self, body: bytes) -> None:
        if self._head.method == "HEAD":
            body = b""
        if self._missing_bytes is not None:
            self._missing_bytes -= len(body)
        head, self._waiting_head = self._waiting_head, None
        if head or body:
            self._transport.write(head + body if head else body)

    def _end(self) -> None:
        if self._missing_bytes:
            _log.error("answer_of_another_length", path=self._head.path, missing_bytes=self._missing_bytes)
            self.keeps_open = False
        self.answered = True
        _wake(self._news)
        self._on_answered()


@cache
def _status_line(status: int) -> bytes:
    return f"HTTP/1.1 {status} {http.HTTPStatus(status).phrase}\r\n".encode("ascii")


def _wake(waiter: "asyncio.Future[None] | None") -> None:
    if waiter is not None and not waiter.done():
        waiter.set_result(None)
