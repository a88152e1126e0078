"""Calibrations of running fluoroscopy, held in memory until it is known which of them the record needs.

Imaging marks the frames of a run. Their calibrations are held until a frame is claimed or the run has ended. A full
localisation may finish after its run has ended: its other frames can still be claimed for a while. A calibration has
about 100 kB, so that what a day of runs left behind would be some tens of megabytes.
"""

from collections import OrderedDict
from typing import Final, Generic, TypeVar

T = TypeVar("T")
V = TypeVar("V")
# Chosen: of the present run, and as many of earlier runs.
MOST_HELD: Final = 256
# Chosen: after the end of its run. A full localisation takes seconds, and a minute on a machine that is busy.
CLAIMED_WITHIN_S: Final = 60.0


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
        self._passed: OrderedDict[str, tuple[float, T]] = OrderedDict()
        self._awaited: OrderedDict[str, None] = OrderedDict()

    def hold(self, sha256: str, value: T) -> None:
        """Hold the value of a frame of the present run."""
        self._held[sha256] = value
        _bound(self._held)

    def claim(self, sha256: str) -> T | None:
        """Remove and return the value of a frame; None when it has not arrived yet, and the frame is then awaited."""
        value = self._held.pop(sha256, None)
        if value is None:
            _, value = self._passed.pop(sha256, (0.0, None))
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

    def end(self, now_s: float) -> list[T]:
        """End the run: remove and return the values of its newest frames, oldest first; the others can be claimed.

        Frames of runs that ended longer ago are let go of. Without a run nothing else happens.
        """
        names = list(self._held)
        newest = [self._held.pop(name) for name in names[max(len(names) - self._newest, 0) :]]
        for name, value in self._held.items():
            self._passed[name] = (now_s, value)
            self._passed.move_to_end(name)
        _bound(self._passed)
        self._held.clear()
        while self._passed and next(iter(self._passed.values()))[0] < now_s - CLAIMED_WITHIN_S:
            self._passed.popitem(last=False)
        return newest


def _bound(frames: OrderedDict[str, V]) -> None:
    """Forget the oldest."""
    while len(frames) > MOST_HELD:
        frames.popitem(last=False)
