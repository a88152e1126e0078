"""One request and its answer between a client and the application, piece by piece, as fast as the slower of the two.

An answer ends where its length says, or with the application's connection, which the application closes wherever it
states no length. A connection on which an answer ended by its length takes the next request; the others are closed.
"""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import h11

from services.ui_api.front.application_socket import (
    PIECE_BYTES,
    ApplicationConnections,
    ApplicationGone,
    ApplicationSocket,
)
from services.ui_api.front.heads import (
    AnswerFraming,
    answer_head,
    forwarded,
    is_chunked,
    is_repeatable,
    is_upgrade,
)


@dataclass(frozen=True, slots=True)
class Client:
    """The client's end of a relay.

    Attributes
    ----------
    parser
        Has parsed the request's head.
    received
        Reads more from the client into the parser; False when the client has left.
    """

    parser: h11.Connection
    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter
    received: Callable[[], Awaitable[bool]]


class Relay:
    """Carries one request.

    Who is answered before his body was passed on whole must close: neither connection takes another request then.
    """

    def __init__(self, client: Client, connections: ApplicationConnections) -> None:
        self._client, self._connections = client, connections
        self._body_sent = False
        self._answered_early = True
        self._reusable = False

    async def carry(self, request: h11.Request, peer: str, scheme: str, *, keeps_open: bool) -> bool:
        """Pass on the request and its answer; whether the client's connection can take another request.

        Raises
        ------
        ApplicationGone
            When nothing was answered.
        """
        connection = await self._connections.take()
        try:
            return await self._exchange(connection, request, forwarded(request, peer, scheme), keeps_open=keeps_open)
        except ApplicationGone:
            if not (connection.used and is_repeatable(request)):
                raise
        anew = await self._connections.take_new()
        return await self._exchange(anew, request, forwarded(request, peer, scheme), keeps_open=keeps_open)

    async def _exchange(
        self, application: ApplicationSocket, request: h11.Request, head: bytes, *, keeps_open: bool
    ) -> bool:
        """Carry it over one connection."""
        try:
            await application.send(head)
            if is_upgrade(request):
                await _first_of(self._outward(application), self._inward(application))
                return False
            answered = await _first_of(
                self._answer(application, request.method, keeps_open=keeps_open),
                self._send_body(application, chunked=is_chunked(request)),
            )
            return keeps_open and answered and not self._answered_early
        finally:
            if self._reusable and not self._answered_early:
                self._connections.give_back(application)
            else:
                application.close()

    async def _send_body(self, application: ApplicationSocket, *, chunked: bool) -> bool:
        """Pass on the body, then wait until the client leaves; what it sends meanwhile stays with the parser."""
        parser = self._client.parser
        while not self._body_sent:
            event = parser.next_event()
            if event is h11.NEED_DATA:
                if parser.they_are_waiting_for_100_continue:
                    self._client.writer.write(b"HTTP/1.1 100 Continue\r\n\r\n")
                if not await self._client.received():
                    return False
            elif isinstance(event, h11.Data):
                content = bytes(event.data)
                await application.send(b"%x\r\n%s\r\n" % (len(content), content) if chunked else content)
            elif isinstance(event, h11.EndOfMessage):
                await application.send(b"0\r\n\r\n" if chunked else b"")
                self._body_sent = True
        while await self._client.received():
            pass
        return False

    async def _answer(self, application: ApplicationSocket, method: bytes, *, keeps_open: bool) -> bool:
        """Pass on the answer; whether it came whole."""
        head = await application.receive_head()
        framing = AnswerFraming.of(head, method)
        self._answered_early = not self._body_sent
        content = application.read_ahead()
        framing.take(content)
        stays_open = keeps_open and not self._answered_early
        self._client.writer.write(answer_head(head, keeps_open=stays_open) + content)
        while not framing.ended and (content := await application.receive()):
            framing.take(content)
            self._client.writer.write(content)
            await self._client.writer.drain()
        await self._client.writer.drain()
        self._reusable = framing.ended and framing.keeps_open
        return framing.whole

    async def _inward(self, application: ApplicationSocket) -> bool:
        """After an upgrade, everything that the client sends."""
        while self._client.parser.next_event() not in (h11.NEED_DATA, h11.PAUSED):
            pass  # the end of a request that has no body
        content = self._client.parser.trailing_data[0] or await self._client.reader.read(PIECE_BYTES)
        while content and await application.send(content):
            content = await self._client.reader.read(PIECE_BYTES)
        return False

    async def _outward(self, application: ApplicationSocket) -> bool:
        """After an upgrade, everything that the application sends."""
        while content := await application.receive():
            self._client.writer.write(content)
            await self._client.writer.drain()
        return True


async def _first_of(main: Awaitable[bool], other: Awaitable[bool]) -> bool:
    """Wait until either ends, and end the other; what `main` returned or raised, False when the other ended first.

    `other` begins: what of a body is there already is sent before an answer is looked for.
    """
    beside, first = asyncio.ensure_future(other), asyncio.ensure_future(main)
    try:
        await asyncio.wait((beside, first), return_when=asyncio.FIRST_COMPLETED)
        is_first_done = first.done()
    finally:
        for task in (beside, first):
            task.cancel()
        await asyncio.gather(beside, first, return_exceptions=True)
    return first.result() if is_first_done else beside.result()
