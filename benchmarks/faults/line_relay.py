"""The controller's line as something that can be cut: a relay between robot service and virtual controller."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial

from shared.threads import supervised_thread

_RECEIVE_BYTES = 4096
_END_WITHIN_S = 5.0


class LineRelay:
    """Carries bytes both ways between whoever connects here and the controller.

    Parameters
    ----------
    overhear
        Called with what goes to the controller, before it gets there.
    """

    def __init__(self, controller_port: int, listener: socket.socket, overhear: Callable[[bytes], None]) -> None:
        self._controller_port = controller_port
        self._listener = listener
        self._overhear = overhear
        self._lock = threading.Lock()
        self._is_cut = False
        self._ends: set[socket.socket] = set()

    @property
    def port(self) -> int:
        """Where the robot service finds the controller."""
        return int(self._listener.getsockname()[1])

    def cut(self) -> None:
        """Hang up both ways, and on everybody who calls from now on."""
        with self._lock:
            self._is_cut = True
            for end in self._ends:
                _hang_up(end)

    def mend(self) -> None:
        """Carry again what comes from now on."""
        with self._lock:
            self._is_cut = False

    def accept_until_closed(self) -> None:
        """Serve each caller on threads of its own."""
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            with suppress(OSError):
                self._join(near)

    def _join(self, near: socket.socket) -> None:
        with self._lock:
            if self._is_cut:
                near.close()
                return
        try:
            far = socket.create_connection(("127.0.0.1", self._controller_port), timeout=_END_WITHIN_S)
        except OSError:
            near.close()
            return
        far.settimeout(None)
        for end in (near, far):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with self._lock:
            self._ends |= {near, far}
        for source, sink, overhear in ((near, far, self._overhear), (far, near, _forget)):
            supervised_thread("line relay", partial(self._carry, source, sink, overhear)).start()

    def _carry(self, source: socket.socket, sink: socket.socket, overhear: Callable[[bytes], None]) -> None:
        with suppress(OSError):
            while received := source.recv(_RECEIVE_BYTES):
                overhear(received)
                sink.sendall(received)
        with self._lock:
            for end in (source, sink):
                _hang_up(end)
            self._ends.discard(source)
        source.close()


def _forget(_: bytes) -> None:
    """Nobody listens."""


def _hang_up(end: socket.socket) -> None:
    with suppress(OSError):
        end.shutdown(socket.SHUT_RDWR)


@contextmanager
def line_relay(controller_port: int, overhear: Callable[[bytes], None] = _forget) -> Iterator[LineRelay]:
    """A relay to a controller on this machine, for as long as the context lasts."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        relay = LineRelay(controller_port, listener, overhear)
        accepting = supervised_thread("line relay", relay.accept_until_closed)
        accepting.start()
        try:
            yield relay
        finally:
            _hang_up(listener)
            relay.cut()
            accepting.join(_END_WITHIN_S)
