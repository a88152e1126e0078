"""Wakes a stream of the event loop from other threads."""

import asyncio


class Awakening:
    """However often it is called for before the stream looks again, the loop has one thing to do.

    Make it on the loop. What there is to see must be there before `call`, and the stream looks after `clear`: at
    everything for which it may be called, also at whether it goes on.
    """

    def __init__(self) -> None:
        self._loop, self._event = asyncio.get_running_loop(), asyncio.Event()
        self._called = False

    def call(self) -> None:
        """Wake the stream; from any thread, never waits."""
        if not self._called:
            self._called = True
            self._loop.call_soon_threadsafe(self._event.set)

    def clear(self) -> None:
        """Sleep at the next `wait`, unless called in between."""
        self._called = False
        self._event.clear()

    async def wait(self) -> None:
        """Wait until called."""
        await self._event.wait()
