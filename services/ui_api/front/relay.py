"""One request and its answer between a client and the application, piece by piece, as fast as the slower of the two.

An answer ends where its length says, or with the application's connection, which the application closes wherever it
states no length. A connection on which an answer ended by its length takes the next request; the others are closed.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass

from services.ui_api.front.application_socket import ApplicationConnections, ApplicationGone, ApplicationSocket
from services.ui_api.front.client_stream import ClientStream
from services.ui_api.front.heads import AnswerFraming, RequestHead, answer_head
from services.ui_api.front.incoming import Incoming


@dataclass(frozen=True, slots=True)
class Client:
    """The client's end of a relay.

    Attributes
    ----------
    on_more
        Called when the client sends something while it waits for its answer.
    """

    stream: ClientStream
    incoming: Incoming
    on_more: Callable[[], None]


class Relay:
    """Carries one request.

    Who is answered before his body was passed on whole must close: neither connection takes another request then.
    """

    def __init__(self, client: Client, connections: ApplicationConnections) -> None:
        self._client, self._connections = client, connections
        self._has_left = self._body_sent = False
        self._answered_early = True
        self._reusable = False

    async def carry(self, head: RequestHead) -> bool:
        """Pass on the request and its answer; whether the client's connection can take another request.

        Raises
        ------
        ApplicationGone
            When nothing was answered.
        """
        connection = await self._connections.take()
        try:
            return await self._exchange(connection, head)
        except ApplicationGone:
            if not (connection.used and head.is_repeatable):
                raise
        return await self._exchange(await self._connections.take_new(), head)

    async def _exchange(self, application: ApplicationSocket, head: RequestHead) -> bool:
        """Carry it over one connection, until the answer has ended or the client has left."""

        def leave() -> None:
            self._has_left = True
            application.give_up()

        try:
            # What comes after an upgrade are no requests.
            on_more = _nothing if head.is_upgrade else self._client.on_more
            with self._client.stream.watched(on_more, leave):
                answered = await self._answered(application, head)
        except ApplicationGone:
            if self._has_left:
                return False
            raise
        else:
            return head.stays_open and answered and not (self._answered_early or self._has_left)
        finally:
            if self._reusable and not (self._answered_early or self._has_left):
                self._connections.give_back(application)
            else:
                application.close()

    async def _answered(self, application: ApplicationSocket, head: RequestHead) -> bool:
        """Pass on the request and the answer; whether that came whole. An upgrade's own bytes follow its answer."""
        await application.send(head.forwarded + self._taken_of_body(head))
        if head.is_upgrade:
            async with _beside(self._inward(application)):
                await self._outward(application)
            return False
        if self._client.incoming.is_whole:
            self._body_sent = True
            return await self._answer(application, head)
        async with _beside(self._send_body(application, head)):
            return await self._answer(application, head)

    async def _send_body(self, application: ApplicationSocket, head: RequestHead) -> None:
        """Pass on the rest of the body, as it comes."""
        incoming = self._client.incoming
        try:
            while not incoming.is_whole:
                if incoming.client_waits_to_go_on:
                    self._client.stream.write(b"HTTP/1.1 100 Continue\r\n\r\n")
                if not await incoming.receive_body():
                    return
                await application.send(self._taken_of_body(head))
        except BaseException:
            application.give_up()  # a body that cannot be read: nobody answers it
            raise
        self._body_sent = True

    def _taken_of_body(self, head: RequestHead) -> bytes:
        """What has come of the body, as the application gets it."""
        pieces = list(self._client.incoming.body_pieces())
        if not head.is_chunked:
            return b"".join(pieces)
        end = b"0\r\n\r\n" if self._client.incoming.is_whole else b""
        return b"".join(b"%x\r\n%s\r\n" % (len(piece), piece) for piece in pieces) + end

    async def _answer(self, application: ApplicationSocket, request: RequestHead) -> bool:
        """Pass on the answer; whether it came whole."""
        stream = self._client.stream
        head = await application.receive_head()
        framing = AnswerFraming.of(head, request.request.method)
        self._answered_early = not self._body_sent
        content = application.read_ahead()
        framing.take(content)
        stays_open = request.stays_open and not self._answered_early
        stream.write(answer_head(head, keeps_open=stays_open) + content)
        while not framing.ended and (content := await application.receive()):
            framing.take(content)
            stream.write(content)
            await stream.drain()
        await stream.drain()
        self._reusable = framing.ended and framing.keeps_open
        return framing.whole

    async def _inward(self, application: ApplicationSocket) -> None:
        """After an upgrade, everything that the client sends."""
        while (content := await self._client.incoming.receive_raw()) and await application.send(content):
            pass

    async def _outward(self, application: ApplicationSocket) -> None:
        """After an upgrade, everything that the application sends."""
        while content := await application.receive():
            self._client.stream.write(content)
            await self._client.stream.drain()


def _nothing() -> None:
    pass


@asynccontextmanager
async def _beside(work: Coroutine[None, None, None]) -> AsyncIterator[None]:
    """Do something else meanwhile; it ends with the context. What it raises is raised."""
    task = asyncio.ensure_future(work)
    await asyncio.sleep(0)  # it begins: what of a body is there already is sent before an answer is looked for
    try:
        yield
    finally:
        task.cancel()
        (failed,) = await asyncio.gather(task, return_exceptions=True)
        if isinstance(failed, Exception):
            raise failed
