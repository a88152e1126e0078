"""Connections to the application whose two directions end apart from each other, and those that wait to be used again.

An application that refuses a body answers and closes while the body is still being sent. The answer must arrive all the
same; a transport of asyncio would give it up together with what could not be sent.
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
# Chosen: several pages that ask at once. The application closes none of them by itself.
_MOST_KEPT: Final = 32
_KEPT_FOR_S: Final = 2.0


class ApplicationGone(Exception):
    """The application took no connection, or ended one before it answered."""


class ApplicationSocket:
    """One connection; `close` it in any case.

    What comes is read as soon as it is there, so that an end is noticed also while nothing is asked for.

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
        self._received = b""
        self._ended = self._is_listening = False
        self._reader: asyncio.Future[None] | None = None

    async def connect(self, address: Path) -> None:
        """Connect; raises `ApplicationGone` when nobody listens."""
        try:
            await self._loop.sock_connect(self._socket, str(address))
        except OSError as error:
            raise ApplicationGone(error.strerror or str(error)) from None
        self._listen()

    @property
    def is_quiet(self) -> bool:
        """Whether it is there, and the application says nothing: it takes a request."""
        return not (self._ended or self._received)

    async def send(self, content: bytes) -> bool:
        """Send; False when the application takes no more."""
        try:
            sent_bytes = self._send_now(content)
            if sent_bytes < len(content):
                await self._loop.sock_sendall(self._socket, content[sent_bytes:])
        except OSError:
            return False
        return True

    async def receive(self) -> bytes:
        """What comes next; empty at the end."""
        while self.is_quiet:
            self._reader = self._loop.create_future()
            try:
                await self._reader
            finally:
                self._reader = None
        content, self._received = self._received, b""
        if not (self._is_listening or self._ended):
            self._listen()
        return content

    async def receive_head(self) -> bytes:
        """The head of an answer; raises `ApplicationGone` when none comes."""
        content = await self.receive()
        while _HEAD_END not in content:
            piece = await self.receive()
            if not piece or len(content) > _MOST_HEAD_BYTES:
                raise ApplicationGone("it ended the connection before it answered")
            content += piece
        head, end, rest = content.partition(_HEAD_END)
        self._received = rest + self._received
        return head + end

    def read_ahead(self) -> bytes:
        """What came with the head."""
        content, self._received = self._received, b""
        return content

    def give_up(self) -> None:
        """Nobody waits for an answer any more: to whoever does, the connection has ended."""
        self._received, self._ended = b"", True
        self._stop_listening()
        self._wake()

    def close(self) -> None:
        """Close."""
        self.give_up()
        self._socket.close()

    def _send_now(self, content: bytes) -> int:
        """How much of it the system takes at once: of nearly every request all."""
        try:
            return self._socket.send(content)
        except BlockingIOError:
            return 0

    def _listen(self) -> None:
        self._loop.add_reader(self._socket, self._take)
        self._is_listening = True

    def _stop_listening(self) -> None:
        if self._is_listening:
            self._loop.remove_reader(self._socket)
            self._is_listening = False

    def _take(self) -> None:
        try:
            piece = self._socket.recv(PIECE_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            piece = b""
        self._received += piece
        self._ended = not piece
        if self._ended or len(self._received) >= PIECE_BYTES:
            self._stop_listening()
        self._wake()

    def _wake(self) -> None:
        if self._reader is not None and not self._reader.done():
            self._reader.set_result(None)


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
            if kept.is_quiet and now_s - kept.idle_since_s < _KEPT_FOR_S:
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
