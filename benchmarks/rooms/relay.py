"""A network between a room and the site, with delay, loss and partition: a relay of TCP on this machine.

Loss is what a program on TCP sees of it: what was lost comes after the time of a retransmission, and all behind it too.
A partition carries nothing either way and closes nothing, as a switch without power.
"""

import random
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from queue import Queue
from typing import Final

from shared.threads import supervised_thread

# The shortest time after which Linux sends again what nobody acknowledged.
RETRANSMISSION_S: Final = 0.2
_RECEIVE_BYTES: Final = 65536
_SEGMENT_BYTES: Final = 1448
_MOST_CHUNKS: Final = 256
_WAIT_S: Final = 0.05


@dataclass(slots=True)
class Network:
    """How it is at the moment; may be changed from any thread.

    Attributes
    ----------
    delay_s
        One way.
    loss
        Probability that a segment is lost.
    carried_bytes
        Both ways since the start.
    """

    delay_s: float = 0.0
    loss: float = 0.0
    carried_bytes: int = 0
    _mended: threading.Event = field(default_factory=threading.Event)
    _random: random.Random = field(default_factory=lambda: random.Random(1))

    def __post_init__(self) -> None:
        self._mended.set()

    def part(self) -> None:
        """Carry nothing from now on."""
        self._mended.clear()

    def mend(self) -> None:
        """Carry again, what waited first."""
        self._mended.set()

    def due_s(self, count: int) -> float:
        """When bytes that came now arrive, on the monotonic clock."""
        segments = -(-count // _SEGMENT_BYTES)
        lost = self._random.random() > (1.0 - self.loss) ** segments
        return time.monotonic() + self.delay_s + RETRANSMISSION_S * lost

    def wait_until_carried(self, closed: threading.Event) -> None:
        """Return when there is no partition, or the relay has ended."""
        while not self._mended.wait(_WAIT_S) and not closed.is_set():
            pass


@dataclass(slots=True)
class Relay:
    """Carries connections to one port of this machine over a network."""

    network: Network
    target_port: int
    listener: socket.socket
    closed: threading.Event = field(default_factory=threading.Event)
    _ends: list[socket.socket] = field(default_factory=list)

    @property
    def port(self) -> int:
        """Where it is reached."""
        return int(self.listener.getsockname()[1])

    def accept_until_closed(self) -> None:
        """Serve each caller."""
        while not self.closed.is_set():
            try:
                near, _ = self.listener.accept()
            except OSError:
                return
            far = socket.create_connection(("127.0.0.1", self.target_port), timeout=5.0)
            far.settimeout(None)
            self._ends += [near, far]
            for source, sink in ((near, far), (far, near)):
                source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                waiting: Queue[tuple[float, bytes]] = Queue(_MOST_CHUNKS)
                supervised_thread("relay in", partial(self._take, source, waiting)).start()
                supervised_thread("relay out", partial(self._give, sink, waiting)).start()

    def close(self) -> None:
        """Hang up on everybody."""
        self.closed.set()
        for end in (self.listener, *self._ends):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def _take(self, source: socket.socket, waiting: "Queue[tuple[float, bytes]]") -> None:
        received = b"-"
        while received:
            try:
                received = source.recv(_RECEIVE_BYTES)
            except OSError:
                received = b""
            waiting.put((self.network.due_s(len(received)), received))

    def _give(self, sink: socket.socket, waiting: "Queue[tuple[float, bytes]]") -> None:
        """Send in order what is due; an empty piece is the end."""
        while True:
            due_s, piece = waiting.get()
            time.sleep(max(due_s - time.monotonic(), 0.0))
            self.network.wait_until_carried(self.closed)
            with suppress(OSError):
                if not piece:
                    sink.shutdown(socket.SHUT_WR)
                    return
                sink.sendall(piece)
            self.network.carried_bytes += len(piece)
            if not piece:
                return


@contextmanager
def network_to(port: int) -> Iterator[tuple[Network, int]]:
    """A network to a port of this machine, and the port at its near end."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        relay = Relay(Network(), port, listener)
        supervised_thread("relay", relay.accept_until_closed).start()
        try:
            yield relay.network, relay.port
        finally:
            relay.close()
