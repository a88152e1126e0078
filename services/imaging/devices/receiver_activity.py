"""What a DICOM receiver is doing, so that it can leave without breaking an image off."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

# Chosen: less than a service has to leave (10 s), and more than an image takes on a slow network.
LEAVE_WITHIN_S: Final = 3.0
# Chosen: a sender whose network says nothing for so long is not within an image.
_QUIET_S: Final = 0.3


class ReceiverActivity:
    """Notes when something came in, and what is being stored."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._storing = 0
        self._last_s = float("-inf")

    def note_received(self, _: object) -> None:
        """Something of an image, or about it, has come in."""
        with self._changed:
            self._last_s = time.monotonic()

    @contextmanager
    def storing(self) -> Iterator[None]:
        """An image is being stored, for as long as the context lasts."""
        with self._changed:
            self._storing += 1
        try:
            yield
        finally:
            with self._changed:
                self._storing -= 1
                self._last_s = time.monotonic()  # its acknowledgement goes out now
                self._changed.notify_all()

    def wait_until_quiet(self, within_s: float = LEAVE_WITHIN_S) -> bool:
        """Wait until nothing is stored and nothing has come in for a moment; False when that takes too long."""
        deadline_s = time.monotonic() + within_s
        with self._changed:
            while (left_s := deadline_s - time.monotonic()) > 0.0:
                quiet_in_s = self._last_s + _QUIET_S - time.monotonic()
                if self._storing == 0 and quiet_in_s <= 0.0:
                    return True
                self._changed.wait(min(left_s, max(quiet_in_s, 0.01)) if self._storing == 0 else left_s)
        return False
