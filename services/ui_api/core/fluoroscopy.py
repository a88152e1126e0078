"""Calibrations of running fluoroscopy, held in memory until it is known which of them the record needs.

Imaging marks the frames of a run. Their calibrations are held until a frame is claimed or the run has ended. A full
localisation may finish after its run has ended: older frames can still be claimed for a while.
"""

from collections import OrderedDict
from typing import Generic, TypeVar

T = TypeVar("T")
# Of the present run, and as many of earlier runs. A full localisation takes seconds, so a frame is held for longer.
MOST_HELD = 256


class FluoroscopyRun(Generic[T]):
    """Holds a value for each frame of the present run, and for frames of earlier runs. Not for several threads.

    Parameters
    ----------
    newest
        How many of a run's newest frames remain when it has ended.
    """

    def __init__(self, newest: int) -> None:
        self._newest = newest
        self._held: OrderedDict[str, T] = OrderedDict()
        self._passed: OrderedDict[str, T] = OrderedDict()
        self._awaited: OrderedDict[str, None] = OrderedDict()

    def hold(self, sha256: str, value: T) -> None:
        """Hold the value of a frame of the present run."""
        self._held[sha256] = value
        _bound(self._held)

    def claim(self, sha256: str) -> T | None:
        """Remove and return the value of a frame; None when it has not arrived yet, and the frame is then awaited."""
        value = self._held.pop(sha256, None)
        if value is None:
            value = self._passed.pop(sha256, None)
        if value is None:
            self._awaited[sha256] = None
            _bound(self._awaited)
        return value

    def was_awaited(self, sha256: str) -> bool:
        """Whether a frame was claimed before it was held; true only once for each claim."""
        if sha256 not in self._awaited:
            return False
        del self._awaited[sha256]
        return True

    def end(self) -> list[T]:
        """End the run: remove and return the values of its newest frames, oldest first; the others can be claimed."""
        names = list(self._held)
        newest = [self._held.pop(name) for name in names[max(len(names) - self._newest, 0) :]]
        self._passed.update(self._held)
        _bound(self._passed)
        self._held.clear()
        return newest


def _bound(frames: OrderedDict[str, T] | OrderedDict[str, None]) -> None:
    """Forget the oldest."""
    while len(frames) > MOST_HELD:
        frames.popitem(last=False)
