"""A deadline on signs of life: pure bookkeeping, the clock is handed in."""

from collections.abc import Callable

from shared.errors import ConfigurationError


class Watchdog:
    """Tells when the last sign of life lies too far back. It is expired until the first one.

    Parameters
    ----------
    deadline_s
        Longest time between two signs of life.
    clock_s
        Monotonic clock in seconds, such as `time.monotonic`.
    """

    def __init__(self, deadline_s: float, clock_s: Callable[[], float]) -> None:
        if deadline_s <= 0.0:
            raise ConfigurationError(f"a watchdog's deadline must be positive, got {deadline_s:g} s")
        self._deadline_s = deadline_s
        self._clock_s = clock_s
        self._last_s: float | None = None

    def feed(self) -> None:
        """Note a sign of life."""
        self._last_s = self._clock_s()

    def forget(self) -> None:
        """Be expired until the next sign of life, as when the sender's boot epoch changed."""
        self._last_s = None

    def silent_for_s(self) -> float:
        """Time since the last sign of life; infinite before the first."""
        last_s = self._last_s
        return float("inf") if last_s is None else self._clock_s() - last_s

    def expired(self) -> bool:
        """Whether the deadline has passed."""
        return self.silent_for_s() > self._deadline_s
