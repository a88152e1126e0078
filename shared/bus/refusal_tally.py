"""Counts what the router has refused, in bounded memory, and says when that is to be published."""

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from shared.bus.router_log import Refusal
from shared.messages.refusals import MOST_REFUSALS, BusRefusal, BusRefusals, RefusalCode

# Chosen: a person who looks sees it at once, and a flood of refusals costs one message a second.
AT_MOST_EVERY_S: Final = 1.0
# Chosen: who joins late learns of earlier ones before anybody misses them.
AGAIN_AFTER_S: Final = 5.0


@dataclass(slots=True)
class _Count:
    times: int
    last_at_ns: int


class RefusalTally:
    """Of one run of the router. Not for several threads."""

    def __init__(self, router_epoch: str) -> None:
        self._router_epoch = router_epoch
        self._totals = dict.fromkeys(RefusalCode, 0)
        self._gaps = 0
        self._counts: OrderedDict[Refusal, _Count] = OrderedDict()
        self._changed: OrderedDict[Refusal, None] = OrderedDict()
        self._published_at_s = float("-inf")
        self._unpublished = True

    def note(self, refusal: Refusal, at_ns: int) -> None:
        """Count one refusal."""
        self._totals[refusal.code] += 1
        count = self._counts.setdefault(refusal, _Count(0, at_ns))
        count.times, count.last_at_ns = count.times + 1, at_ns
        self._counts.move_to_end(refusal)
        self._changed[refusal] = None
        for kept in (self._counts, self._changed):
            if len(kept) > MOST_REFUSALS:
                kept.popitem(last=False)
        self._unpublished = True

    def note_gap(self) -> None:
        """Refusals may have been lost, because they came faster than they could be counted."""
        self._gaps += 1
        self._unpublished = True

    def due(self, now_s: float) -> tuple[BusRefusals, tuple[BusRefusal, ...]] | None:
        """What to publish now, and what of it has changed since the last time; None when it is not time yet."""
        waited_s = now_s - self._published_at_s
        if waited_s < (AT_MOST_EVERY_S if self._unpublished else AGAIN_AFTER_S):
            return None
        changed = tuple(self._entry(refusal) for refusal in self._changed if refusal in self._counts)
        self._changed.clear()
        self._published_at_s, self._unpublished = now_s, False
        return self._message(), changed

    def _message(self) -> BusRefusals:
        return BusRefusals(
            router_epoch=self._router_epoch,
            messages_denied=self._totals[RefusalCode.MESSAGE_DENIED],
            links_refused=self._totals[RefusalCode.LINK_REFUSED],
            unknown_names=self._totals[RefusalCode.UNKNOWN_NAME],
            gaps=self._gaps,
            newest=tuple(self._entries()),
        )

    def _entries(self) -> Iterator[BusRefusal]:
        return (self._entry(refusal) for refusal in self._counts)

    def _entry(self, refusal: Refusal) -> BusRefusal:
        count = self._counts[refusal]
        return BusRefusal(
            code=refusal.code,
            service=refusal.service,
            what=refusal.what,
            key=refusal.key,
            times=count.times,
            last_at_ns=count.last_at_ns,
        )
