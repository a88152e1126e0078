"""Wakes event streams when the log has grown. The streams read the log themselves: it is the only truth."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from shared.threads import report_error


class Feed:
    """Wakers may be called from any thread and must not block."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._wakers: set[Callable[[], None]] = set()
        self.closed = False

    @contextmanager
    def listening(self, waker: Callable[[], None]) -> Iterator[None]:
        """Call `waker` whenever the log has grown, for as long as the context lasts."""
        with self._lock:
            self._wakers.add(waker)
        try:
            yield
        finally:
            with self._lock:
                self._wakers.discard(waker)

    def wake(self) -> None:
        """The log has grown."""
        with self._lock:
            for waker in self._wakers:
                try:
                    waker()
                except Exception as error:  # noqa: BLE001 - one stream that has gone must not keep the others asleep
                    report_error("an event stream", error)

    def close(self) -> None:
        """End all streams."""
        self.closed = True
        self.wake()
