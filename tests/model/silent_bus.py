"""A bus on which nothing happens by itself: handlers are kept, and called when the model says so."""

from collections.abc import Callable
from types import TracebackType
from typing import Self

from shared.bus.port import Answer, Publisher, Query, QueryHandler, Sample


class SilentBus:
    """Keeps what was declared, and what was published last.

    Attributes
    ----------
    put
        The last value of each key.
    replies
        Called for every question asked on this bus; raises what the asker is to see.
    """

    def __init__(self) -> None:
        self.put: dict[str, bytes] = {}
        self.replies: Callable[[str, bytes], bytes] = _nobody
        self._subscribers: dict[str, Callable[[Sample], None]] = {}
        self._queryables: dict[str, QueryHandler] = {}

    def answer(self, key: str, payload: bytes) -> bytes | None:
        """Put a question to whoever answers on a key; None when the answer comes later."""
        answer = self._queryables[key](Query(key, payload))
        return answer.payload if isinstance(answer, Answer) else None

    def publish(self, key: str, payload: bytes) -> None:
        """Give a sample to whoever subscribed to a key."""
        self._subscribers[key](Sample(key, payload, b""))

    def publisher(self, key: str) -> Publisher:
        """Keeps the last value."""
        return _Kept(self.put, key)

    def retained_publisher(self, key: str) -> Publisher:
        """Keeps the last value."""
        return _Kept(self.put, key)

    def subscribe(self, key: str, handler: Callable[[Sample], None]) -> "_Declared":
        """Keep the handler."""
        self._subscribers[key] = handler
        return _Declared()

    def subscribe_attachments(self, key: str, handler: Callable[[bytes], None]) -> "_Declared":
        """Keep the handler."""
        return self.subscribe(key, lambda sample: handler(sample.attachment))

    def subscribe_retained(self, key: str, handler: Callable[[Sample], None]) -> "_Declared":
        """Keep the handler."""
        return self.subscribe(key, handler)

    def queryable(self, key: str, handler: QueryHandler) -> "_Declared":
        """Keep the handler."""
        self._queryables[key] = handler
        return _Declared()

    def query(self, key: str, payload: bytes, timeout_s: float) -> Answer:  # noqa: ARG002 - the port's
        """Ask the model."""
        return Answer(self.replies(key, payload))

    def presence(self) -> "_Linked":
        """The link is up: that it is lost shows as heartbeats that do not come."""
        return _Linked()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class _Declared:
    def close(self) -> None:
        """Nothing to take back."""


class _Kept:
    def __init__(self, put: dict[str, bytes], key: str) -> None:
        self._put, self._key = put, key

    def put(self, payload: bytes, attachment: bytes = b"") -> None:  # noqa: ARG002 - the port's
        self._put[self._key] = payload

    def close(self) -> None:
        """Nothing to take back."""


class _Linked:
    def declare_alive(self, key: str) -> _Declared:  # noqa: ARG002 - the port's
        return _Declared()

    def watch_alive(self, key: str, handler: Callable[[str, bool], None]) -> _Declared:  # noqa: ARG002 - the port's
        return _Declared()

    def link_up(self) -> bool:
        return True


def _nobody(key: str, payload: bytes) -> bytes:
    raise AssertionError(f"nobody answers on {key}")
