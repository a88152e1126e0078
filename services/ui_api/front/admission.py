"""How many connections and requests the front takes at once: bookkeeping without a socket.

A stop needs a connection and nothing else, so connections are always taken: where there are too many, the one that has
been idle the longest is closed. What needs a second handle, a request to the application, is refused beyond its bound.
"""

import resource
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

# For the bus, the log, the loop, the listening sockets, and connections that are accepted before another one is closed.
RESERVED_HANDLES: Final = 128
MOST_RELAYS: Final = 512
MOST_CONNECTIONS: Final = 4096


@dataclass(frozen=True, slots=True)
class Limits:
    """How many connections, and how many requests that the application works on."""

    connections: int
    relays: int

    @staticmethod
    def of(handles: int) -> "Limits":
        """What a process with so many handles can take: one for each connection, one more for each relayed request."""
        free = max(handles - RESERVED_HANDLES, 8)
        relays = min(MOST_RELAYS, free // 4)
        return Limits(min(MOST_CONNECTIONS, free - relays), relays)


def raised_handle_limit() -> int:
    """Let this process have as many handles as the system allows it; that many."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    return MOST_CONNECTIONS * 2 if hard == resource.RLIM_INFINITY else hard


class Place:
    """A connection's place. `close` ends the connection."""

    __slots__ = ("close",)

    def __init__(self, close: Callable[[], None]) -> None:
        self.close = close


class Admission:
    """Counts connections and relayed requests, and knows which connections are idle.

    Attributes
    ----------
    streams
        Connections that were handed on to the application and stream, as it counts them.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self._places: set[Place] = set()
        self._idle: OrderedDict[Place, None] = OrderedDict()
        self.relays = 0
        self.streams = 0
        self.closed_idle = 0
        self.refused = 0

    @property
    def connections(self) -> int:
        """Connections that are open now."""
        return len(self._places)

    def enter(self, place: Place) -> None:
        """Take a new connection in, idle as yet; where there are too many, the longest idle one is closed."""
        if len(self._places) >= self.limits.connections and self._idle:
            longest, _ = self._idle.popitem(last=False)
            self._places.discard(longest)
            self.closed_idle += 1
            longest.close()
        self._places.add(place)
        self._idle[place] = None

    def leave(self, place: Place) -> None:
        """Forget a connection that has ended."""
        self._places.discard(place)
        self._idle.pop(place, None)

    def idle(self, place: Place) -> None:
        """Note that a connection waits for its next request, from now on."""
        if place in self._places:
            self._idle[place] = None
            self._idle.move_to_end(place)

    def busy(self, place: Place) -> None:
        """Note that a connection has sent a request: it is not closed for another one's sake."""
        self._idle.pop(place, None)

    def note_streams(self, count: int) -> None:
        """Take over the application's own count."""
        self.streams = count

    def has_place_for_stream(self) -> bool:
        """Whether the application may be handed one more connection that streams."""
        return self.streams + self.relays < self.limits.relays

    def take_relay(self) -> bool:
        """Whether one more request may go to the application; `end_relay` gives its place back."""
        if self.streams + self.relays >= self.limits.relays:
            self.refused += 1
            return False
        self.relays += 1
        return True

    def end_relay(self) -> None:
        """Give a place back."""
        self.relays -= 1
