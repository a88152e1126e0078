"""The gateway's leaving: from then on it answers what it has begun, and stops, and nothing new."""

import threading
from typing import Final

DETAIL: Final = "the gateway ends or restarts and begins nothing new; a stop is still sent; try again in some seconds"
# Chosen: a restart takes about as long.
AGAIN: Final = {"retry-after": "5"}


class Leaving:
    """Whether it has begun; any thread may ask."""

    def __init__(self) -> None:
        self._begun = threading.Event()

    def begin(self) -> None:
        """From now on."""
        self._begun.set()

    @property
    def has_begun(self) -> bool:
        """Whether the gateway leaves."""
        return self._begun.is_set()
