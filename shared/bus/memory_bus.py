"""The bus within one process, for tests and for programs that need no router. Same contract suite as Zenoh's.

A `MemoryRouter` stands for the router: `router.open()` gives a session, `router.cut()` and `router.restore()` take the
link away from all sessions and give it back.
"""

import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self, TypeVar

from shared.bus.key_expressions import includes
from shared.bus.port import Answer, Query, Sample
from shared.bus.replies import error_text, no_answer, no_reply_in_time, replied_with_error
from shared.bus.workers import Worker

D = TypeVar("D", bound="_Declared")


class MemoryRouter:
    """What all sessions of one in-memory bus share."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._up = True
        self._subscribers: list[_Subscriber] = []
        self._queryables: list[_Queryable] = []
        self._watchers: list[_Watcher] = []
        self._tokens: list[_Token] = []
        self._retained: list[_RetainedPublisher] = []

    def open(self) -> "MemoryBus":
        """A new session."""
        return MemoryBus(self)

    def cut(self) -> None:
        """Lose the link of all sessions: tokens vanish, samples are lost, queries bring no answer."""
        with self._lock:
            self._up = False
            for token in self._tokens:
                self._announce(token.key, alive=False)

    def restore(self) -> None:
        """Give the link back: tokens return, and retained values that were put meanwhile arrive."""
        with self._lock:
            self._up = True
            for token in self._tokens:
                self._announce(token.key, alive=True)
            for publisher in self._retained:
                publisher.deliver_missed()

    @property
    def up(self) -> bool:
        """Whether the link is there."""
        return self._up

    def deliver(self, sample: Sample) -> bool:
        """Hand a sample to everyone who listens; False when the link is down."""
        with self._lock:
            if self._up:
                for subscriber in self._subscribers:
                    subscriber.offer(sample)
            return self._up

    def add_subscriber(self, subscriber: "_Subscriber") -> None:
        """Begin to deliver to it."""
        with self._lock:
            self._subscribers.append(subscriber)

    def add_retained_subscriber(self, subscriber: "_Subscriber") -> None:
        """Begin to deliver to it, the retained values first."""
        with self._lock:
            self._subscribers.append(subscriber)
            for publisher in self._retained:
                if self._up and publisher.last is not None:
                    subscriber.offer(publisher.last)

    def add_retained_publisher(self, publisher: "_RetainedPublisher") -> None:
        """Remember whose last value late joiners get."""
        with self._lock:
            self._retained.append(publisher)

    def add_queryable(self, queryable: "_Queryable") -> None:
        """Begin to put queries to it."""
        with self._lock:
            self._queryables.append(queryable)

    def queryable_for(self, key: str) -> "_Queryable | None":
        """The one that answers a key, if any and if the link is up."""
        with self._lock:
            found = [q for q in self._queryables if includes(q.key, key)]
            return found[0] if found and self._up else None

    def add_token(self, token: "_Token") -> None:
        """Announce a liveliness token."""
        with self._lock:
            self._tokens.append(token)
            if self._up:
                self._announce(token.key, alive=True)

    def add_watcher(self, watcher: "_Watcher") -> None:
        """Tell about all tokens that are there, then about changes."""
        with self._lock:
            self._watchers.append(watcher)
            for token in self._tokens:
                if self._up:
                    watcher.offer(token.key, alive=True)

    def remove(self, declared: "_Declared") -> None:
        """Take any declaration back; harmless when it is gone already."""
        with self._lock:
            if isinstance(declared, _Token) and declared in self._tokens:
                self._tokens.remove(declared)
                if self._up:
                    self._announce(declared.key, alive=False)
            for others in (self._subscribers, self._queryables, self._watchers, self._retained):
                if declared in others:
                    others.remove(declared)  # type: ignore[arg-type]  # each list holds one kind of `_Declared`

    def _announce(self, key: str, *, alive: bool) -> None:
        for watcher in self._watchers:
            watcher.offer(key, alive=alive)


class _Declared:
    """Anything a session declared; `close` takes it back."""

    def __init__(self, router: MemoryRouter, key: str) -> None:
        self.router = router
        self.key = key

    def close(self) -> None:
        self.router.remove(self)


class _Working(_Declared):
    """A declaration whose handler runs on a thread of its own."""

    def __init__(self, router: MemoryRouter, key: str) -> None:
        super().__init__(router, key)
        self.worker = Worker(key)

    def close(self) -> None:
        super().close()
        self.worker.close()


class _Subscriber(_Working):
    def __init__(self, router: MemoryRouter, key: str, handler: Callable[[Sample], None]) -> None:
        super().__init__(router, key)
        self._handler = handler

    def offer(self, sample: Sample) -> None:
        if includes(self.key, sample.key):
            self.worker.submit(lambda: self._handler(sample))


class _Watcher(_Working):
    def __init__(self, router: MemoryRouter, key: str, handler: Callable[[str, bool], None]) -> None:
        super().__init__(router, key)
        self._handler = handler

    def offer(self, key: str, *, alive: bool) -> None:
        if includes(self.key, key):
            self.worker.submit(lambda: self._handler(key, alive))


class _Queryable(_Working):
    def __init__(self, router: MemoryRouter, key: str, handler: Callable[[Query], Answer]) -> None:
        super().__init__(router, key)
        self._handler = handler

    def ask(self, query: Query, pending: "_Pending") -> None:
        self.worker.submit(lambda: self._answer(query, pending))

    def _answer(self, query: Query, pending: "_Pending") -> None:
        try:
            pending.settle(self._handler(query))
        except Exception as error:
            pending.settle(error_text(error))
            raise


class _Token(_Declared):
    pass


class _Publisher(_Declared):
    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        self.router.deliver(Sample(self.key, payload, attachment))


class _RetainedPublisher(_Declared):
    def __init__(self, router: MemoryRouter, key: str) -> None:
        super().__init__(router, key)
        self.last: Sample | None = None
        self._missed = False

    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        self.last = Sample(self.key, payload, attachment)
        self._missed = not self.router.deliver(self.last)

    def deliver_missed(self) -> None:
        if self._missed and self.last is not None:
            self._missed = not self.router.deliver(self.last)


class _Pending:
    """A query that waits for its first outcome: an answer, or the text of an error."""

    def __init__(self) -> None:
        self._settled = threading.Event()
        self.outcome: Answer | str | None = None

    def settle(self, outcome: Answer | str) -> None:
        self.outcome = outcome
        self._settled.set()

    def wait(self, timeout_s: float) -> Answer | str | None:
        self._settled.wait(timeout_s)
        return self.outcome


class MemoryBus:
    """One session on an in-memory bus: a `Bus`, and its own `Presence`."""

    def __init__(self, router: MemoryRouter) -> None:
        self._router = router
        self._declared: list[_Declared] = []

    def publisher(self, key: str) -> _Publisher:
        """See `Bus`."""
        return self._keep(_Publisher(self._router, key))

    def retained_publisher(self, key: str) -> _RetainedPublisher:
        """See `Bus`."""
        publisher = self._keep(_RetainedPublisher(self._router, key))
        self._router.add_retained_publisher(publisher)
        return publisher

    def subscribe(self, key: str, handler: Callable[[Sample], None]) -> _Declared:
        """See `Bus`."""
        subscriber = self._keep(_Subscriber(self._router, key, handler))
        self._router.add_subscriber(subscriber)
        return subscriber

    def subscribe_retained(self, key: str, handler: Callable[[Sample], None]) -> _Declared:
        """See `Bus`."""
        subscriber = self._keep(_Subscriber(self._router, key, handler))
        self._router.add_retained_subscriber(subscriber)
        return subscriber

    def queryable(self, key: str, handler: Callable[[Query], Answer]) -> _Declared:
        """See `Bus`."""
        queryable = self._keep(_Queryable(self._router, key, handler))
        self._router.add_queryable(queryable)
        return queryable

    def query(self, key: str, payload: bytes, timeout_s: float) -> Answer:
        """See `Bus`; raises `NoReply`."""
        queryable = self._router.queryable_for(key)
        if queryable is None:
            raise no_answer(key)
        pending = _Pending()
        queryable.ask(Query(key, payload), pending)
        outcome = pending.wait(timeout_s)
        if outcome is None:
            raise no_reply_in_time(key, timeout_s)
        if isinstance(outcome, str):
            raise replied_with_error(key, outcome)
        return outcome

    def presence(self) -> "MemoryBus":
        """The session itself."""
        return self

    def declare_alive(self, key: str) -> _Declared:
        """See `Presence`."""
        token = self._keep(_Token(self._router, key))
        self._router.add_token(token)
        return token

    def watch_alive(self, key: str, handler: Callable[[str, bool], None]) -> _Declared:
        """See `Presence`."""
        watcher = self._keep(_Watcher(self._router, key, handler))
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
