"""Hands a client's connection itself on to the application: what streams for hours does not pass through the front."""

import os
import socket
from typing import Final

# Of a head, which is all that goes along; the socket between the processes takes it in one piece.
_MOST_BYTES: Final = 64 * 1024


class Handover:
    """The front's end of the socket over which connections go, one a message. Never waits."""

    def __init__(self, line: socket.socket) -> None:
        self._line = line
        self._line.setblocking(False)  # noqa: FBT003 - the standard library's signature

    def give(self, connection: socket.socket, content: bytes) -> bool:
        """Hand on a connection with what has been read from it; False when the application does not take it now.

        The connection stays open in the application when it is closed here.
        """
        if len(content) > _MOST_BYTES:
            return False
        handle = os.dup(connection.fileno())
        try:
            socket.send_fds(self._line, [content], [handle])
        except OSError:
            return False
        finally:
            os.close(handle)
        return True
