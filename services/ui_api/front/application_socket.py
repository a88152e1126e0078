"""A connection to the application whose two directions end apart from each other.

An application that refuses a body answers and closes while the body is still being sent. The answer must arrive all the
same; a stream of asyncio would give it up together with what could not be sent.
"""

import asyncio
import socket
from pathlib import Path
from typing import Final

# Chosen: bounds on memory and on what the loop does in one go (decision 22).
PIECE_BYTES: Final = 64 * 1024
_MOST_HEAD_BYTES: Final = 64 * 1024
_HEAD_END: Final = b"\r\n\r\n"


class ApplicationGone(Exception):
    """The application took no connection, or ended one before it answered."""


class ApplicationSocket:
    """One connection; `close` it in any case."""

    def __init__(self) -> None:
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
            content, self._read_ahead = self._read_ahead, b""
            return content
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

    def close(self) -> None:
        """Close."""
        self._socket.close()
