"""A time by which something must have come, which is moved with each request and hardly ever due."""

import asyncio
from collections.abc import Callable
from math import inf


class Deadline:
    """Calls when it is due. It is moved at next to no cost: its timer looks, when it rings, whether it still holds."""

    def __init__(self, on_due: Callable[[], None]) -> None:
        self._loop = asyncio.get_running_loop()
        self._on_due, self._due_s = on_due, inf
        self._timer: asyncio.TimerHandle | None = None

    def set(self, within_s: float) -> None:
        """From now on it is that long."""
        self._due_s = self._loop.time() + within_s
        if self._timer is not None and self._timer.when() <= self._due_s:
            return
        self._ring_at(self._due_s)

    def clear(self) -> None:
        """Nothing is waited for."""
        self._due_s = inf

    def end(self) -> None:
        """It is not needed any more."""
        self._due_s = inf
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _ring_at(self, at_s: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._loop.call_at(at_s, self._ring)

    def _ring(self) -> None:
        self._timer = None
        if self._due_s <= self._loop.time():
            self._on_due()
        elif self._due_s < inf:
            self._ring_at(self._due_s)
