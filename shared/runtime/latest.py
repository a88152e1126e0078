"""Bounded hand-over from the bus's threads to a service's own: a slot that keeps the newest, a queue that refuses."""

import threading
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class LatestSlot(Generic[T]):
    """Holds one value; a newer one replaces it. For frames and states, where only the newest counts.

    `replaced` counts the values that nobody took.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._values: deque[T] = deque(maxlen=1)
        self._closed = False
        self.replaced = 0

    def put(self, value: T) -> T | None:
        """Leave a value, in place of one that was not taken, which is returned; never waits."""
        with self._changed:
            before = self._values.popleft() if self._values else None
            self.replaced += before is not None
            self._values.append(value)
            self._changed.notify()
            return before

    def take(self, timeout_s: float | None = None) -> T | None:
        """Wait for a value and remove it; None after `timeout_s`, or at once when closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._values or self._closed, timeout_s)
            return None if self._closed or not self._values else self._values.popleft()

    def close(self) -> None:
        """Wake whoever waits; nothing is handed out any more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


class BoundedQueue(Generic[T]):
    """First in, first out, of fixed size; a full queue refuses. For work that must not be lost unnoticed.

    `refused` counts the values that did not fit.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._changed = threading.Condition()
        self._values: deque[T] = deque()
        self._closed = False
        self.refused = 0

    def put(self, value: T) -> bool:
        """Append; False when the queue is full or closed. Never waits."""
        with self._changed:
            if self._closed or len(self._values) >= self._size:
                self.refused += 1
                return False
            self._values.append(value)
            self._changed.notify()
            return True

    def take(self, timeout_s: float | None = None) -> T | None:
        """Wait for the oldest value and remove it; None after `timeout_s`, or at once when closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._values or self._closed, timeout_s)
            return None if self._closed or not self._values else self._values.popleft()

    def close(self) -> None:
        """Wake whoever waits; nothing is handed out any more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def __len__(self) -> int:
        return len(self._values)
