"""Frames of a running fluoroscopy on their way to the record: most of them are looked at for a moment and never again.

A frame belongs to a run when it was received soon after the one before it; everything else is a single shot. What was
measured in a run's frames is held back until one of them is claimed, or the run has ended. A full localisation may take
longer than what is left of its run: frames that were not among the newest can be claimed for a while afterwards too.
"""

from collections import OrderedDict
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")
# Of a run, and of those that have ended. A full localisation takes seconds: a frame must be held for so long that it
# can still be claimed afterwards.
MOST_HELD = 256


@dataclass(frozen=True, slots=True)
class RunLimits:
    """What makes a run, and what is left of it.

    Attributes
    ----------
    interval_s
        Longest time between two frames of a run.
    newest
        How many of its newest frames are left when it has ended.
    """

    interval_s: float
    newest: int


class FluoroscopyRun(Generic[T]):
    """Holds what was measured in the frames of one run after another. Not for several threads."""

    def __init__(self, limits: RunLimits) -> None:
        self._limits = limits
        self._held: OrderedDict[str, T] = OrderedDict()
        self._passed: OrderedDict[str, T] = OrderedDict()
        self._awaited: OrderedDict[str, None] = OrderedDict()
        self._last_ns: int | None = None

    def holds(self, sha256: str, received_at_ns: int, value: T) -> bool:
        """Hold a frame of a run; False for a single shot (which may be the first of a run): it is the caller's."""
        if sha256 not in self._held:
            since_ns = None if self._last_ns is None else received_at_ns - self._last_ns
            self._last_ns = received_at_ns
            if since_ns is None or not 0 < since_ns < 1e9 * self._limits.interval_s:
                return False
        self._held[sha256] = value
        _bound(self._held)
        return True

    def claim(self, sha256: str) -> T | None:
        """What is held of a frame that somebody needs; it is held no longer. What is not there yet is awaited."""
        value = self._held.pop(sha256, None)
        if value is None:
            value = self._passed.pop(sha256, None)
        if value is None:
            self._awaited[sha256] = None
            _bound(self._awaited)
        return value

    def was_awaited(self, sha256: str) -> bool:
        """Whether a frame was claimed before it was held; it is awaited no longer."""
        if sha256 not in self._awaited:
            return False
        del self._awaited[sha256]
        return True

    def end(self) -> list[T]:
        """What is left of a run that has ended: its newest frames, the oldest first; the others wait for a claim."""
        names = list(self._held)
        newest = [self._held.pop(name) for name in names[max(len(names) - self._limits.newest, 0) :]]
        self._passed.update(self._held)
        _bound(self._passed)
        self._held.clear()
        return newest


def _bound(frames: OrderedDict[str, T] | OrderedDict[str, None]) -> None:
    """Forget the oldest."""
    while len(frames) > MOST_HELD:
        frames.popitem(last=False)
