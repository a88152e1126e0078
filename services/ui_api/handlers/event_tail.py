"""The newest events in memory, for all who follow the log closely: what is new is read and rendered once for all."""

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from services.ui_api.core.events import Event

# Chosen: half a minute of fluoroscopy; who is further behind reads the database.
_KEPT: Final = 1024


@dataclass(slots=True)
class TailEvent:
    """An event, and its text once somebody has wanted it."""

    event: Event
    text: str = ""

    def rendered(self, render: Callable[[Event], str]) -> str:
        """The text, made by the first who asks."""
        self.text = self.text or render(self.event)
        return self.text


@dataclass(frozen=True, slots=True)
class News:
    """Events after a place in the log, and the place up to which they go."""

    events: tuple[TailEvent, ...]
    through: int


class EventTail:
    """Filled by the record's listener, read by the event streams."""

    def __init__(self, head_sequence: int) -> None:
        self._lock = threading.Lock()
        self._kept: deque[TailEvent] = deque(maxlen=_KEPT)
        self._through = head_sequence

    def take(self, events: Sequence[Event]) -> None:
        """Append what is on record now."""
        with self._lock:
            self._kept.extend(TailEvent(event) for event in events)
            self._through = events[-1].sequence

    def after(self, sequence: int) -> News | None:
        """What came after a place in the log; None when that is no longer kept here."""
        with self._lock:
            missed = self._through - sequence
            if missed > len(self._kept):
                return None
            newest = tuple(self._kept)[len(self._kept) - missed :] if missed > 0 else ()
            return News(newest, max(self._through, sequence))
