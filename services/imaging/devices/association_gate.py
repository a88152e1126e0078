"""Who is let in to the DICOM receiver: a connection counts only once its association request has arrived whole.

pynetdicom counts every connection as an association for up to 30 s, also one that was closed at once: a dozen port
probes would keep the C-arm out for half a minute. Here a connection without a request costs a socket and a thread for
two seconds at most, the newest ones push out the oldest of the same address, and what is counted are associations.
"""

import contextlib
import socket
import socketserver
import ssl
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from typing import Final

from pynetdicom.transport import RequestHandler, ThreadedAssociationServer

REQUEST_WITHIN_S: Final = 2.0
"""For the whole association request; a C-arm sends it within milliseconds of connecting."""
# Chosen: bounds on memory and sockets, far above what the C-arms of one room need and far below a process's handles.
_WAITING_PER_ADDRESS: Final = 8
_WAITING: Final = 64
_ADDRESSES_COUNTED: Final = 256
_BACKLOG: Final = 128
# Chosen: below 10 ms, which nobody notices; above what costs a core anything.
_POLL_S: Final = 0.005
_REQUEST_PDU: Final = 0x01
# DICOM PS3.8, section 9.3.1: type, reserved byte and length of a PDU.
_HEADER_BYTES: Final = 6
_LEAST_BYTES: Final = 74  # the request's fixed part, without which there are no titles
_MOST_BYTES: Final = 64 * 1024  # 128 presentation contexts with ten transfer syntaxes each take half of it


class WaitingRoom:
    """Connections whose request has not arrived; the oldest of an address, or of all, has to go for a new one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: OrderedDict[socket.socket, str] = OrderedDict()
        self._closed = False

    def enter(self, connection: socket.socket, address: str) -> None:
        """Let a connection wait."""
        with self._lock:
            self._waiting[connection] = address
            of_address = [one for one, where in self._waiting.items() if where == address]
            if self._closed or len(of_address) > _WAITING_PER_ADDRESS:
                _end(of_address[0])
                del self._waiting[of_address[0]]
            elif len(self._waiting) > _WAITING:
                _end(self._waiting.popitem(last=False)[0])

    def leave(self, connection: socket.socket) -> None:
        """It waits no more."""
        with self._lock:
            self._waiting.pop(connection, None)

    def close(self) -> None:
        """Send everybody home, now and from now on."""
        with self._lock:
            self._closed = True
            for connection in self._waiting:
                _end(connection)


def _end(connection: socket.socket) -> None:
    """Its handler sees the end of the stream; it closes the socket."""
    with contextlib.suppress(OSError):  # the other side was faster
        connection.shutdown(socket.SHUT_RDWR)


def request_arrives(connection: socket.socket, within_s: float) -> bool:
    """Whether a whole association request arrives in time; it stays in the socket, for pynetdicom to read."""
    deadline_s = time.monotonic() + within_s
    while (left_s := deadline_s - time.monotonic()) > 0.0:
        connection.settimeout(left_s)
        try:
            arrived = connection.recv(_MOST_BYTES, socket.MSG_PEEK)
        except OSError:
            return False
        if not arrived or arrived[0] != _REQUEST_PDU:
            return False
        if len(arrived) >= _HEADER_BYTES:
            needed = _HEADER_BYTES + int.from_bytes(arrived[2:_HEADER_BYTES], "big")
            if not _LEAST_BYTES <= needed <= _MOST_BYTES:
                return False
            if len(arrived) >= needed:
                return True
        time.sleep(min(_POLL_S, left_s))
    return False


class GatedServer(ThreadedAssociationServer):
    """pynetdicom's server behind the gate. `on_no_request` gets address and count, the first time and every tenfold."""

    daemon_threads = True
    request_queue_size = _BACKLOG
    on_no_request: Callable[[str, int], None]
    on_untrusted: Callable[[str, str], None]
    tls: ssl.SSLContext | None = None
    tls_senders: frozenset[str] = frozenset()

    def verify_request(self, request: object, client_address: tuple[str, int]) -> bool:
        """Note the connection before it has a thread; called on the one that accepts, so nothing here waits."""
        assert isinstance(request, socket.socket)
        self.waiting.enter(request, str(client_address[0]))
        return True

    def server_activate(self) -> None:
        """Begin to listen, with nobody in."""
        self.waiting = WaitingRoom()
        self._lock = threading.Lock()
        self._without_request: OrderedDict[str, int] = OrderedDict()
        super().server_activate()

    def note_no_request(self, address: str) -> None:
        """Count a connection that was none, and report it now and then: a storm of them must not fill the log."""
        with self._lock:
            count = self._without_request.pop(address, 0) + 1
            self._without_request[address] = count
            while len(self._without_request) > _ADDRESSES_COUNTED:
                self._without_request.popitem(last=False)
        if str(count).strip("0") == "1":
            self.on_no_request(address, count)

    def shutdown(self) -> None:
        """End, without waiting for those who wait."""
        self.waiting.close()
        socketserver.BaseServer.shutdown(self)
        self.server_close()


class GatedHandler(RequestHandler):
    """Makes an association of a connection only once it has asked for one."""

    def handle(self) -> None:
        """On a thread of the connection's own."""
        server, connection = self.server, self.request
        assert isinstance(server, GatedServer)
        if server.tls is None:
            arrived = request_arrives(connection, REQUEST_WITHIN_S)
        else:
            # Who has proved who it is need not be hurried: pynetdicom waits for its request, and not for ever.
            arrived = self._is_trusted(server, server.tls)
        server.waiting.leave(connection)
        if arrived:
            super().handle()
            return
        server.note_no_request(str(self.client_address[0]))
        server.shutdown_request(self.request)

    def _is_trusted(self, server: "GatedServer", tls: ssl.SSLContext) -> bool:
        """Whether the other side proves in time, by a certificate, that it is one that may send."""
        self.request.settimeout(REQUEST_WITHIN_S)
        try:
            self.request = tls.wrap_socket(self.request, server_side=True)
        except OSError as error:  # of TLS, too
            server.on_untrusted(str(self.client_address[0]), f"no link under TLS: {error}")
            return False
        name = common_name(self.request.getpeercert())
        if server.tls_senders and name not in server.tls_senders:
            allowed = ", ".join(sorted(server.tls_senders))
            why = f"its certificate names {name!r}; the setting dicom_tls_senders allows {allowed}"
            server.on_untrusted(str(self.client_address[0]), why)
            return False
        return True


def common_name(certificate: Mapping[str, object] | None) -> str | None:
    """The common name that a certificate states, as `ssl` reads it; None where it states none."""
    subject = (certificate or {}).get("subject", ())
    assert isinstance(subject, tuple)
    return next((str(value) for part in subject for key, value in part if key == "commonName"), None)
