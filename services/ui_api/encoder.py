"""The process that turns frames into pictures for viewers: `python -m services.ui_api.encoder`, started by the gateway.

Its standard input is a socket: one frame comes in, one picture goes out, until the other end closes. It has no link to
the bus, no files and no settings, so that whatever happens in it happens to the live picture alone. It gives way to the
application, as that does to robot and front: a picture may be late, a motion and a stop may not.
"""

import os
import socket
import struct
import sys
from typing import Final

import numpy as np

from services.ui_api.core.picture import jpeg_of

# Height and width in pixels; grey values follow, as little-endian float32, row by row.
REQUEST: Final = struct.Struct("<II")
# Length of the picture that follows, in bytes.
REPLY: Final = struct.Struct("<I")
BYTES_PER_PIXEL: Final = 4
# Than the application that started it.
_LESS_URGENT: Final = 5


def main() -> int:
    """Exit code: 0 when the gateway has closed its end."""
    os.nice(_LESS_URGENT)
    with socket.socket(fileno=sys.stdin.fileno()) as gateway:
        while encode_one(gateway):
            pass
    return 0


def encode_one(gateway: socket.socket) -> bool:
    """Answer one frame with its picture; False when the other end has closed."""
    request = received(gateway, REQUEST.size)
    if request is None:
        return False
    height_px, width_px = REQUEST.unpack(request)
    payload = received(gateway, height_px * width_px * BYTES_PER_PIXEL)
    if payload is None:
        return False
    picture = jpeg_of(np.frombuffer(payload, dtype="<f4").reshape(height_px, width_px))
    gateway.sendall(REPLY.pack(len(picture)) + picture)
    return True


def received(other: socket.socket, size_bytes: int) -> bytearray | None:
    """Exactly so many bytes; None when the other end closes before."""
    content = bytearray(size_bytes)
    rest = memoryview(content)
    while rest:
        count = other.recv_into(rest)
        if count == 0:
            return None
        rest = rest[count:]
    return content


if __name__ == "__main__":
    sys.exit(main())
