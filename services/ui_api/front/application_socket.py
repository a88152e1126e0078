"""Connections to the application whose two directions end apart from each other, and those that wait to be used again.

An application that refuses a body answers and closes while the body is still being sent. The answer must arrive all the
same; a stream of asyncio would give it up together with what could not be sent.
"""

import asyncio
import socket
from collections import deque
from pathlib import Path
from typing import Final

# Chosen: bounds on memory and on what the loop does in one go (decision 22).
PIECE_BYTES: Final = 64 * 1024
_MOST_HEAD_BYTES: Final = 64 * 1024
_HEAD_END: Final = b"\r\n\r\n"
# Chosen: several pages that ask at once; and much less than the application's own patience (`server`), so that it never
# closes a connection on which a request is on its way.
_MOST_KEPT: Final = 32
_KEPT_FOR_S: Final = 2.0


class ApplicationGone(Exception):
    """The application took no connection, or ended one before it answered."""


class ApplicationSocket:
    """One connection; `close` it in any case.

    Attributes
    ----------
    used
        Whether a request was answered on it before.
    """

    def __init__(self) -> None:
        self.used = False
        self.idle_since_s = 0.0
        self._loop = asyncio.get_running_loop()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.setblocking(False)  # noqa: FBT003 - the standard library's signature
        self._read_ahead = b""

    async def connect(self, address: Path) -> None:
        """Connect; raises `ApplicationGone` when nobody listens."""
        try:
            await self._loop.sock_connect(self._socket, str(address))
        except OSError as error:
            raise ApplicationGone(error.strerror or str(error)) from None

    async def send(self, content: bytes) -> bool:
        """Send; False when the application takes no more."""
        try:
            await self._loop.sock_sendall(self._socket, content)
        except OSError:
            return False
        return True

    async def receive(self) -> bytes:
        """What comes next; empty at the end."""
        if self._read_ahead:
            return self.read_ahead()
        try:
            return await self._loop.sock_recv(self._socket, PIECE_BYTES)
        except OSError:
            return b""

    async def receive_head(self) -> bytes:
        """The head of an answer; raises `ApplicationGone` when none comes."""
        content = b""
        while _HEAD_END not in content:
            piece = await self.receive()
            if not piece or len(content) > _MOST_HEAD_BYTES:
                raise ApplicationGone("it ended the connection before it answered")
            content += piece
        head, end, self._read_ahead = content.partition(_HEAD_END)
        return head + end

    def read_ahead(self) -> bytes:
        """What came with the head."""
        content, self._read_ahead = self._read_ahead, b""
        return content

    def close(self) -> None:
        """Close."""
        self._socket.close()


class ApplicationConnections:
    """Connections to one application; those on which an answer has ended are kept for a moment, for the next request.

    For one event loop.
    """

    def __init__(self, address: Path) -> None:
        self._address = address
        self._idle: deque[ApplicationSocket] = deque()

    async def take(self) -> ApplicationSocket:
        """A connection, the last one that became free or a new one; raises `ApplicationGone` when nobody listens."""
        now_s = asyncio.get_running_loop().time()
        while self._idle:
            kept = self._idle.pop()
            if now_s - kept.idle_since_s < _KEPT_FOR_S:
                return kept
            kept.close()
        return await self.take_new()

    async def take_new(self) -> ApplicationSocket:
        """A new connection; raises `ApplicationGone` when nobody listens."""
        connection = ApplicationSocket()
        try:
            await connection.connect(self._address)
        except BaseException:
            connection.close()
            raise
        return connection

    def give_back(self, connection: ApplicationSocket) -> None:
        """Keep a connection whose last answer has ended, and was read whole."""
        connection.used, connection.idle_since_s = True, asyncio.get_running_loop().time()
        self._idle.append(connection)
        if len(self._idle) > _MOST_KEPT:
            self._idle.popleft().close()

    def close(self) -> None:
        """Close those that wait."""
        while self._idle:
            self._idle.pop().close()
