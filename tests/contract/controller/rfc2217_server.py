"""pyserial's own RFC 2217 server in front of a virtual controller: a serial line at the far end of a network."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import serial
from serial.rfc2217 import PortManager

_POLL_S = 0.1
_RECEIVE_BYTES = 4096
_END_WITHIN_S = 60.0


class _Connection:
    """What the port manager writes its negotiation to."""

    def __init__(self, client: socket.socket) -> None:
        self._client = client
        self._lock = threading.Lock()

    def write(self, data: bytes) -> None:
        with self._lock:
            self._client.sendall(data)


@contextmanager
def rfc2217_server(gcs_port: int) -> Iterator[int]:
    """Serve the controller at a TCP port of this machine by RFC 2217, to one client at a time; yields the port."""
    ending = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(_POLL_S)
        serving = threading.Thread(target=_serve, args=(listener, gcs_port, ending), name="rfc2217", daemon=True)
        serving.start()
        try:
            yield listener.getsockname()[1]
        finally:
            ending.set()
            serving.join(_END_WITHIN_S)


def _serve(listener: socket.socket, gcs_port: int, ending: threading.Event) -> None:
    while not ending.is_set():
        try:
            client, _ = listener.accept()
        except TimeoutError:
            continue
        with client, socket.create_connection(("127.0.0.1", gcs_port)) as line:
            for end in (client, line):
                end.settimeout(_POLL_S)
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            _converse(client, line, ending)


def _converse(client: socket.socket, line: socket.socket, ending: threading.Event) -> None:
    """Carry bytes both ways, as a serial server would; the settings that the client asks for go to a dummy port."""
    # The stubs ask for more than the manager uses.
    manager = PortManager(serial.serial_for_url("loop://"), _Connection(client))  # type: ignore[arg-type]
    gone = threading.Event()

    def to_client() -> None:
        with suppress(OSError):
            while not (gone.is_set() or ending.is_set()):
                data = _received(line)
                if data is not None:
                    client.sendall(b"".join(manager.escape(data)))

    replies = threading.Thread(target=to_client, name="rfc2217 replies", daemon=True)
    replies.start()
    with suppress(OSError):
        while not ending.is_set():
            data = _received(client)
            if data == b"":
                break
            if data is not None:
                line.sendall(b"".join(manager.filter(data)))
    gone.set()
    replies.join(_END_WITHIN_S)


def _received(end: socket.socket) -> bytes | None:
    """What has come, nothing when the other end has gone, None when nothing came."""
    try:
        return end.recv(_RECEIVE_BYTES)
    except TimeoutError:
        return None
