"""How fast a line carries bytes: as a serial line does, one after another, or at once."""

import time
from collections.abc import Callable, Iterator

# A start bit, eight bits, a stop bit.
_BITS_PER_BYTE = 10


class LineRate:
    """One direction of a line.

    Parameters
    ----------
    baud
        Bits per second; None for a line that takes no time.
    clock_s, sleep
        Monotonic clock, and how to wait.
    """

    def __init__(
        self,
        baud: int | None,
        clock_s: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.baud = baud
        self._clock_s = clock_s
        self._sleep = sleep
        self._free_s = float("-inf")

    def arriving(self, content: bytes) -> Iterator[bytes]:
        """Pieces of the content, each at the time of its arrival at the other end."""
        if self.baud is None:
            yield content
            return
        for byte in content:
            # Not from now on but from when the byte before was through: a sleep that took too long is caught up with.
            self._free_s = max(self._free_s, self._clock_s()) + _BITS_PER_BYTE / self.baud
            if (early_s := self._free_s - self._clock_s()) > 0.0:
                self._sleep(early_s)
            yield bytes([byte])
