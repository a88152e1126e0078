"""A camera whose frames a test hands out one by one."""

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

PATIENCE_S = 60.0
Picture = NDArray[np.uint8]


class FakeCamera:
    """A live source: it gives its frames as soon as it is read, and waits when there are none left."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._shown: Callable[[], Picture] = lambda: np.zeros((4, 4), np.uint8)
        self._left = 0
        self._is_waiting = self._is_unplugged = False

    def show(self, shown: Callable[[], Picture], count: int = 1) -> None:
        """Hand out so many frames, and wait until whoever reads them asks for one more."""
        with self._changed:
            self._shown, self._left, self._is_waiting = shown, count, False
            self._changed.notify_all()
            assert self._changed.wait_for(lambda: self._is_waiting, PATIENCE_S), f"{self._left} frames were not read"

    def unplug(self) -> None:
        """Give no frame any more."""
        with self._changed:
            self._is_unplugged = True
            self._changed.notify_all()

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        """Whether it can be read."""
        return not self._is_unplugged

    def read(self) -> tuple[bool, Picture | None]:
        """Wait for a frame."""
        with self._changed:
            self._is_waiting = self._left == 0
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._left or self._is_unplugged, PATIENCE_S)
            if not self._left:
                return False, None
            self._left -= 1
            return True, self._shown()

    def get(self, propId: int, /) -> float:
        """Any property."""
        return float(propId)

    def release(self) -> None:
        """Nothing is to be closed."""
