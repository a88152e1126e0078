"""What sessions of the in-memory bus declare: publishers, subscribers, queryables, tokens and watchers."""

import threading
from collections.abc import Callable

from shared.bus.key_expressions import includes
from shared.bus.port import Answer, Query, QueryHandler, Sample
from shared.bus.replies import answered, error_text, outcome_of
from shared.bus.workers import Worker


class Declared:
    """Anything a session declared; `close` takes it back. Closing it twice is harmless.

    Parameters
    ----------
    take_back
        What the router does with it then.
    """

    def __init__(self, key: str, take_back: "Callable[[Declared], None]") -> None:
        self.key = key
        self._take_back = take_back

    def close(self) -> None:
        """Take it back."""
        self._take_back(self)


class Token(Declared):
    """A liveliness token."""


class _Working(Declared):
    """A declaration whose handler runs on a thread of its own."""

    def __init__(self, key: str, take_back: Callable[[Declared], None]) -> None:
        super().__init__(key, take_back)
        self.worker = Worker(key)

    def close(self) -> None:
        """Take it back and end its thread."""
        super().close()
        self.worker.close()


class Subscriber(_Working):
    """Hands samples to a handler."""

    def __init__(self, key: str, take_back: Callable[[Declared], None], handler: Callable[[Sample], None]) -> None:
        super().__init__(key, take_back)
        self._handler = handler

    def offer(self, sample: Sample) -> None:
        """Hand it over when the key is covered."""
        if includes(self.key, sample.key):
            self.worker.submit(lambda: self._handler(sample))


class Watcher(_Working):
    """Hands news of tokens to a handler."""

    def __init__(self, key: str, take_back: Callable[[Declared], None], handler: Callable[[str, bool], None]) -> None:
        super().__init__(key, take_back)
        self._handler = handler

    def offer(self, key: str, *, alive: bool) -> None:
        """Hand it over when the key is covered."""
        if includes(self.key, key):
            self.worker.submit(lambda: self._handler(key, alive))


class Pending:
    """A query that waits for its first outcome: an answer, or the text of an error."""

    def __init__(self) -> None:
        self._settled = threading.Event()
        self._outcome: Answer | str | None = None

    def settle(self, outcome: Answer | str) -> None:
        """Here it is."""
        self._outcome = outcome
        self._settled.set()

    def wait(self, timeout_s: float) -> Answer | str | None:
        """The outcome, or None after the time."""
        self._settled.wait(timeout_s)
        return self._outcome


class Queryable(_Working):
    """Lets a handler answer queries."""

    def __init__(self, key: str, take_back: Callable[[Declared], None], handler: QueryHandler) -> None:
        super().__init__(key, take_back)
        self._handler = handler

    def ask(self, query: Query, pending: Pending) -> None:
        """Answer later, on the queryable's own thread."""
        self.worker.submit(lambda: self._answer(query, pending))

    def _answer(self, query: Query, pending: Pending) -> None:
        try:
            answer = answered(self._handler, query)
        except Exception as error:
            pending.settle(error_text(error))
            raise
        if isinstance(answer, Answer):
            pending.settle(answer)
        else:
            answer.add_done_callback(lambda done: pending.settle(outcome_of(done)))


class Publisher(Declared):
    """Publishes one key and keeps nothing."""

    def __init__(self, key: str, take_back: Callable[[Declared], None], deliver: Callable[[Sample], bool]) -> None:
        super().__init__(key, take_back)
        self._deliver = deliver

    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        """Hand it to everyone who listens now."""
        self._deliver(Sample(self.key, payload, attachment))


class RetainedPublisher(Declared):
    """Publishes one key and keeps the last value."""

    def __init__(self, key: str, take_back: Callable[[Declared], None], deliver: Callable[[Sample], bool]) -> None:
        super().__init__(key, take_back)
        self._deliver = deliver
        self._missed = False
        self.last: Sample | None = None

    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        """Hand it to everyone who listens now, and keep it for those who come later."""
        self.last = Sample(self.key, payload, attachment)
        self._missed = not self._deliver(self.last)

    def deliver_missed(self) -> None:
        """Hand the last value over when it was put while there was no link."""
        if self._missed and self.last is not None:
            self._missed = not self._deliver(self.last)
