"""Whoever acts goes before whoever watches: who acts now, for those who watch to wait a moment."""

import asyncio
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Final

# Chosen: several times what a motion takes from its request to the robot; who waits for another service (a plan, ten
# seconds at most) must not freeze the picture.
_WATCHERS_WAIT_S: Final = 0.3


class Acting:
    """Counts what acts. Any thread may begin and end it, and any event loop wait."""

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._clock_s, self._lock = clock_s, threading.Lock()
        self._count = 0
        self._since_s = 0.0
        self._wakers: set[Callable[[], None]] = set()

    @property
    def count(self) -> int:
        """How many act now."""
        return self._count

    @property
    def waiting(self) -> int:
        """How many wait for those who act."""
        with self._lock:
            return len(self._wakers)

    def begin(self) -> None:
        """Somebody acts."""
        with self._lock:
            if self._count == 0:
                self._since_s = self._clock_s()
            self._count += 1

    def end(self) -> None:
        """He has acted."""
        with self._lock:
            self._count -= 1
            wakers = () if self._count else tuple(self._wakers)
        for wake in wakers:
            with suppress(RuntimeError):  # a loop that has ended
                wake()

    @contextmanager
    def acting(self) -> Iterator[None]:
        """Act for as long as the context lasts."""
        self.begin()
        try:
            yield
        finally:
            self.end()

    async def nobody(self) -> None:
        """Wait until nobody acts, or somebody has for a moment."""
        if self._left_s() <= 0.0:
            return
        loop, free = asyncio.get_running_loop(), asyncio.Event()

        def wake() -> None:
            loop.call_soon_threadsafe(free.set)

        with self._woken(wake):
            left_s = self._left_s()  # it may have ended before the waker was there
            if left_s > 0.0:
                with suppress(TimeoutError):
                    await asyncio.wait_for(free.wait(), left_s)

    def wait_until_nobody(self) -> None:
        """The same for a thread."""
        free = threading.Event()
        with self._woken(free.set):
            free.wait(max(self._left_s(), 0.0))

    @contextmanager
    def _woken(self, wake: Callable[[], None]) -> Iterator[None]:
        with self._lock:
            self._wakers.add(wake)
        try:
            yield
        finally:
            with self._lock:
                self._wakers.discard(wake)

    def _left_s(self) -> float:
        with self._lock:
            return self._since_s + _WATCHERS_WAIT_S - self._clock_s() if self._count else 0.0
