"""A bus on which everything happens at once, on the caller's thread: for robot benchmarks whose time stands still."""

from collections.abc import Callable
from types import TracebackType
from typing import Self

from shared.bus.port import Answer, Query, QueryHandler, Sample
from shared.errors import NoReply


class _Declared:
    """What can be taken back; in a benchmark nobody does."""

    def close(self) -> None:
        """Nothing to do."""


class _Publisher(_Declared):
    def __init__(self, bus: "StillBus", key: str) -> None:
        self._bus, self._key = bus, key

    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        """Hand it to everyone who listens, now."""
        self._bus.deliver(Sample(self._key, payload, attachment))


class StillBus:
    """A `Bus` and its own `Presence`, for one process and one thread."""

    def __init__(self) -> None:
        self.up = True
        self._subscribers: list[tuple[str, Callable[[Sample], None]]] = []
        self._queryables: dict[str, QueryHandler] = {}
        self._watchers: list[tuple[str, Callable[[str, bool], None]]] = []

    def deliver(self, sample: Sample) -> None:
        """Call every subscriber of the key; nobody while the link is down."""
        for key, handler in self._subscribers if self.up else ():
            if key == sample.key:
                handler(sample)

    def tell_alive(self, key: str, *, alive: bool) -> None:
        """A token appears or vanishes."""
        for watched, handler in self._watchers:
            if watched == key:
                handler(key, alive)

    def publisher(self, key: str) -> _Publisher:
        """See `Bus`."""
        return _Publisher(self, key)

    def retained_publisher(self, key: str) -> _Publisher:
        """See `Bus`; everyone listens from the beginning here."""
        return _Publisher(self, key)

    def subscribe(self, key: str, handler: Callable[[Sample], None]) -> _Declared:
        """See `Bus`."""
        self._subscribers.append((key, handler))
        return _Declared()

    def subscribe_attachments(self, key: str, handler: Callable[[bytes], None]) -> _Declared:
        """See `Bus`."""
        return self.subscribe(key, lambda sample: handler(sample.attachment))

    def subscribe_retained(self, key: str, handler: Callable[[Sample], None]) -> _Declared:
        """See `Bus`."""
        return self.subscribe(key, handler)

    def queryable(self, key: str, handler: QueryHandler) -> _Declared:
        """See `Bus`."""
        self._queryables[key] = handler
        return _Declared()

    def query(self, key: str, payload: bytes, timeout_s: float) -> Answer:
        """See `Bus`; raises `NoReply` while the link is down. What needs time to answer has none here: it is empty."""
        if not self.up:
            raise NoReply(f"no answer on '{key}' within {timeout_s:g} s: the link is down")
        answer = self._queryables[key](Query(key, payload))
        return answer if isinstance(answer, Answer) else Answer(b"")

    def presence(self) -> "StillBus":
        """The bus itself."""
        return self

    def declare_alive(self, key: str) -> _Declared:
        """See `Presence`."""
        self.tell_alive(key, alive=True)
        return _Declared()

    def watch_alive(self, key: str, handler: Callable[[str, bool], None]) -> _Declared:
        """See `Presence`."""
        self._watchers.append((key, handler))
        return _Declared()

    def link_up(self) -> bool:
        """See `Presence`."""
        return self.up

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return None
