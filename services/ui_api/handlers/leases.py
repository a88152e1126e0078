"""Hold-to-move: a motion lasts only as long as someone renews its lease; when it lapses, the robot is stopped."""

import threading
from collections import OrderedDict
from collections.abc import Callable
from functools import partial

from services.ui_api.handlers.clock import Clock
from shared.threads import supervised_thread

# Chosen: a bound on memory, more than a day's motions.
_MOST_LAPSED = 1024


class Leases:
    """Watches leases on a thread of its own between `start` and `close`.

    Parameters
    ----------
    lease_s
        How long a lease lasts from its grant or renewal.
    on_lapse
        Called once with the operation's id when its lease lapses; it may take its time, others are not held up by it.

    Attributes
    ----------
    lapsed
        How many leases have lapsed.
    """

    def __init__(self, clock: Clock, lease_s: float, on_lapse: Callable[[str], None]) -> None:
        self._clock = clock
        self.lease_s = lease_s
        self._on_lapse = on_lapse
        self._changed = threading.Condition()
        self._deadline_s: dict[str, float] = {}
        self._lapsed: OrderedDict[str, None] = OrderedDict()
        self._closed = False
        self.lapsed = 0
        self._thread = supervised_thread("leases", self._watch)

    def start(self) -> None:
        """Begin to watch."""
        self._thread.start()

    def close(self) -> None:
        """End watching; leases that are still held lapse, because nobody would watch them."""
        with self._changed:
            self._closed = True
            held = list(self._deadline_s)
            self._deadline_s.clear()
            self._note_lapsed(held)
            self._changed.notify_all()
        for operation_id in held:
            self._on_lapse(operation_id)

    @property
    def held(self) -> int:
        """How many leases are held now."""
        return len(self._deadline_s)

    def grant(self, operation_id: str) -> None:
        """Begin a lease."""
        with self._changed:
            self._deadline_s[operation_id] = self._clock.monotonic_s() + self.lease_s
            self._changed.notify_all()

    def renew(self, operation_id: str) -> bool:
        """Begin the lease anew; False when it has lapsed or was never granted."""
        with self._changed:
            deadline_s = self._deadline_s.get(operation_id)
            if deadline_s is None or deadline_s <= self._clock.monotonic_s():
                return False
            self._deadline_s[operation_id] = self._clock.monotonic_s() + self.lease_s
            return True

    def release(self, operation_id: str) -> None:
        """End a lease whose operation is over."""
        with self._changed:
            self._deadline_s.pop(operation_id, None)

    def has_lapsed(self, operation_id: str) -> bool:
        """Whether a granted lease has lapsed."""
        with self._changed:
            deadline_s = self._deadline_s.get(operation_id)
            overdue = deadline_s is not None and deadline_s <= self._clock.monotonic_s()
            return overdue or operation_id in self._lapsed

    def _note_lapsed(self, operation_ids: list[str]) -> None:
        """Remember the newest; a command that waits to be sent was asked for a moment ago."""
        self._lapsed.update(dict.fromkeys(operation_ids))
        self.lapsed += len(operation_ids)
        while len(self._lapsed) > _MOST_LAPSED:
            self._lapsed.popitem(last=False)

    def _watch(self) -> None:
        while (lapsed := self._wait_for_lapse()) is not None:
            for operation_id in lapsed:
                supervised_thread("lapse", partial(self._on_lapse, operation_id)).start()

    def _wait_for_lapse(self) -> list[str] | None:
        """Ids whose leases have lapsed, at least one; None when closed."""
        with self._changed:
            while not self._closed:
                now_s = self._clock.monotonic_s()
                lapsed = [i for i, deadline_s in self._deadline_s.items() if deadline_s <= now_s]
                if lapsed:
                    for operation_id in lapsed:
                        del self._deadline_s[operation_id]
                    self._note_lapsed(lapsed)
                    return lapsed
                nearest_s = min(self._deadline_s.values(), default=now_s + 3600.0)
                self._changed.wait(nearest_s - now_s)
            return None
