"""The bus within one process, for tests and for programs that need no router. Same contract suite as Zenoh's.

A `MemoryRouter` stands for the router: `router.open()` gives a session, `router.cut()` and `router.restore()` take the
link away from all sessions and give it back.
"""

import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self, TypeVar

from shared.bus.key_expressions import includes
from shared.bus.memory_declarations import (
    Declared,
    Pending,
    Publisher,
    Queryable,
    RetainedPublisher,
    Subscriber,
    Token,
    Watcher,
)
from shared.bus.port import Answer, Query, QueryHandler, Sample
from shared.bus.replies import no_answer, no_reply_in_time, replied_with_error
from shared.tracing import current_traceparent

D = TypeVar("D", bound=Declared)


class MemoryRouter:
    """What all sessions of one in-memory bus share."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._up = True
        self._declared: list[Declared] = []

    def open(self) -> "MemoryBus":
        """A new session."""
        return MemoryBus(self)

    def cut(self) -> None:
        """Lose the link of all sessions: tokens vanish, samples are lost, queries bring no answer."""
        with self._lock:
            self._up = False
            for token in self._of(Token):
                self._announce(token.key, alive=False)

    def restore(self) -> None:
        """Give the link back: tokens return, and retained values that were put meanwhile arrive."""
        with self._lock:
            self._up = True
            for token in self._of(Token):
                self._announce(token.key, alive=True)
            for publisher in self._of(RetainedPublisher):
                publisher.deliver_missed()

    @property
    def up(self) -> bool:
        """Whether the link is there."""
        return self._up

    def add(self, declared: D) -> D:
        """Take part in what the bus carries."""
        with self._lock:
            self._declared.append(declared)
            return declared

    def add_subscriber_with_history(self, subscriber: Subscriber) -> None:
        """Begin to deliver to it, the retained values first."""
        with self._lock:
            self.add(subscriber)
            for publisher in self._of(RetainedPublisher):
                if self._up and publisher.last is not None:
                    subscriber.offer(publisher.last)

    def add_token(self, token: Token) -> None:
        """Announce a liveliness token."""
        with self._lock:
            self.add(token)
            if self._up:
                self._announce(token.key, alive=True)

    def add_watcher(self, watcher: Watcher) -> None:
        """Tell about all tokens that are there, then about changes."""
        with self._lock:
            self.add(watcher)
            for token in self._of(Token):
                if self._up:
                    watcher.offer(token.key, alive=True)

    def remove(self, declared: Declared) -> None:
        """Take any declaration back; harmless when it is gone already."""
        with self._lock:
            if declared not in self._declared:
                return
            self._declared.remove(declared)
            if isinstance(declared, Token) and self._up:
                self._announce(declared.key, alive=False)

    def deliver(self, sample: Sample) -> bool:
        """Hand a sample to everyone who listens; False when the link is down."""
        with self._lock:
            if self._up:
                for subscriber in self._of(Subscriber):
                    subscriber.offer(sample)
            return self._up

    def queryable_for(self, key: str) -> Queryable | None:
        """The one that answers a key, if any and if the link is up."""
        with self._lock:
            found = [q for q in self._of(Queryable) if includes(q.key, key)]
            return found[0] if found and self._up else None

    def _of(self, kind: type[D]) -> list[D]:
        return [declared for declared in self._declared if isinstance(declared, kind)]

    def _announce(self, key: str, *, alive: bool) -> None:
        for watcher in self._of(Watcher):
            watcher.offer(key, alive=alive)


class MemoryBus:
    """One session on an in-memory bus: a `Bus`, and its own `Presence`."""

    def __init__(self, router: MemoryRouter) -> None:
        self._router = router
        self._declared: list[Declared] = []

    def publisher(self, key: str) -> Publisher:
        """See `Bus`."""
        return self._router.add(self._keep(Publisher(key, self._router.remove, self._router.deliver)))

    def retained_publisher(self, key: str) -> RetainedPublisher:
        """See `Bus`."""
        return self._router.add(self._keep(RetainedPublisher(key, self._router.remove, self._router.deliver)))

    def subscribe(self, key: str, handler: Callable[[Sample], None]) -> Subscriber:
        """See `Bus`."""
        return self._router.add(self._keep(Subscriber(key, self._router.remove, handler)))

    def subscribe_attachments(self, key: str, handler: Callable[[bytes], None]) -> Subscriber:
        """See `Bus`."""
        return self.subscribe(key, lambda sample: handler(sample.attachment))

    def subscribe_retained(self, key: str, handler: Callable[[Sample], None]) -> Subscriber:
        """See `Bus`."""
        subscriber = self._keep(Subscriber(key, self._router.remove, handler))
        self._router.add_subscriber_with_history(subscriber)
        return subscriber

    def queryable(self, key: str, handler: QueryHandler) -> Queryable:
        """See `Bus`."""
        return self._router.add(self._keep(Queryable(key, self._router.remove, handler)))

    def query(self, key: str, payload: bytes, timeout_s: float) -> Answer:
        """See `Bus`; raises `NoReply`."""
        queryable = self._router.queryable_for(key)
        if queryable is None:
            raise no_answer(key)
        pending = Pending()
        queryable.ask(Query(key, payload, current_traceparent() or ""), pending)
        outcome = pending.wait(timeout_s)
        if outcome is None:
            raise no_reply_in_time(key, timeout_s)
        if isinstance(outcome, str):
            raise replied_with_error(key, outcome)
        return outcome

    def presence(self) -> "MemoryBus":
        """The session itself."""
        return self

    def declare_alive(self, key: str) -> Token:
        """See `Presence`."""
        token = self._keep(Token(key, self._router.remove))
        self._router.add_token(token)
        return token

    def watch_alive(self, key: str, handler: Callable[[str, bool], None]) -> Watcher:
        """See `Presence`."""
        watcher = self._keep(Watcher(key, self._router.remove, handler))
        self._router.add_watcher(watcher)
        return watcher

    def link_up(self) -> bool:
        """See `Presence`."""
        return self._router.up

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for declared in reversed(self._declared):
            declared.close()

    def _keep(self, declared: D) -> D:
        self._declared.append(declared)
        return declared
