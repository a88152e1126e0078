"""The bus as services see it. Two implementations, one contract suite: `zenoh_bus` and `memory_bus`.

Handlers run on the bus's own threads: keep them short and hand over to a bounded slot or queue of your own. A handler
that raises is logged and reported to the asker as an error; it never takes the bus down.
"""

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from types import TracebackType
from typing import Protocol, Self, TypeAlias


@dataclass(frozen=True, slots=True)
class Sample:
    """One published value; two are the same by whatever way they came."""

    key: str
    payload: bytes
    attachment: bytes
    by_shared_memory: bool = field(default=False, compare=False)


@dataclass(frozen=True, slots=True)
class Query:
    """One question put to a queryable; `traceparent` names what it was asked for (`shared.tracing`), if anything."""

    key: str
    payload: bytes
    traceparent: str = ""


@dataclass(frozen=True, slots=True)
class Answer:
    """One reply to a query."""

    payload: bytes
    attachment: bytes = b""


# Whoever has to wait for its answer returns a future, and is handed the next question meanwhile.
QueryHandler: TypeAlias = Callable[[Query], Answer | Future[Answer]]


class Subscription(Protocol):
    """Something declared on the bus that can be taken back."""

    def close(self) -> None:
        """Take it back; later samples or queries are not delivered. Calling it twice is harmless."""


class Publisher(Protocol):
    """A declared publisher of one key."""

    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        """Publish; never blocks on a slow consumer."""

    def close(self) -> None:
        """Take it back."""


class Bus(Protocol):
    """A session on the bus. Use as a context manager; leaving closes everything that was declared."""

    def publisher(self, key: str) -> Publisher:
        """Publisher of streams (frames, heartbeats): drops rather than blocks, keeps nothing."""

    def retained_publisher(self, key: str) -> Publisher:
        """Publisher whose last value reaches late joiners of `subscribe_retained` too (state, results, plans)."""

    def subscribe(self, key: str, handler: Callable[[Sample], None]) -> Subscription:
        """Every sample from now on."""

    def subscribe_attachments(self, key: str, handler: Callable[[bytes], None]) -> Subscription:
        """The attachment of every sample from now on, for whoever has no use for megabytes of payload."""

    def subscribe_retained(self, key: str, handler: Callable[[Sample], None]) -> Subscription:
        """The last retained value, if any, then every sample."""

    def queryable(self, key: str, handler: QueryHandler) -> Subscription:
        """Answer queries on a key expression, one after another. An exception becomes an error reply.

        The handler works for the trace of whoever asks.
        """

    def query(self, key: str, payload: bytes, timeout_s: float) -> Answer:
        """Ask and wait for the first reply.

        Raises
        ------
        NoReply
            No reply within the time, or an error reply (its text is in the message). Neither means "not carried out".
        BusUnavailable
            The session takes no question: it was closed.
        """

    def presence(self) -> "Presence":
        """Liveliness tokens and the state of the link."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class Presence(Protocol):
    """Who is alive, and whether the router is there."""

    def declare_alive(self, key: str) -> Subscription:
        """Hold a liveliness token on a key until closed."""

    def watch_alive(self, key: str, handler: Callable[[str, bool], None]) -> Subscription:
        """Call with (key, alive) for tokens that are there, appear or vanish; all vanish when the link is lost."""

    def link_up(self) -> bool:
        """Whether a router is connected now."""
