"""What the router refuses, as the gateway hears it: figures at once, events at a bounded rate.

Whoever is refused may try for days; the record cannot forget, so that it must not grow by that. The router's numbers
only grow, so what one event leaves out stands in the next.
"""

from typing import Final

from services.ui_api.core.bus_event_data import BusRefused, RefusedOnBus
from services.ui_api.handlers.clock import Clock
from shared.messages.refusals import BusRefusal, BusRefusals, RefusalCode

# Chosen: what a person tries by hand is on record at once; a program that never stops makes 1440 events a day.
MOST_AT_ONCE: Final = 100
ONE_MORE_AFTER_S: Final = 60.0
_Sender = tuple[str, str, str, str]


class BusRefusalLog:
    """The newest report, and what of it is on record. Not for several threads, but for reading `newest`."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._recorded: dict[_Sender, int] = {}
        self._left = float(MOST_AT_ONCE)
        self._counted_at_s = clock.monotonic_s()
        self._recorded_gaps = 0
        self.newest: BusRefusals | None = None

    def note(self, report: BusRefusals) -> BusRefused | None:
        """Take a report; returns an event when there is something new and an event may be recorded now."""
        if self.newest is None or self.newest.router_epoch != report.router_epoch:
            self._recorded, self._recorded_gaps = {}, 0
        self.newest = report
        new = tuple(entry for entry in report.newest if self._recorded.get(_sender(entry)) != entry.times)
        if not (new or report.gaps > self._recorded_gaps) or not self._may_record():
            return None
        self._recorded = {_sender(entry): entry.times for entry in report.newest}
        self._recorded_gaps = report.gaps
        return BusRefused(
            report.router_epoch,
            report.messages_denied,
            report.links_refused,
            report.unknown_names,
            report.gaps,
            tuple(_named(entry) for entry in new),
        )

    def figures(self) -> dict[str, float]:
        """Refusals of this run of the router by their code; NaN before it has reported."""
        seen = self.newest
        if seen is None:
            return dict.fromkeys(RefusalCode, float("nan"))
        return {
            RefusalCode.MESSAGE_DENIED: seen.messages_denied,
            RefusalCode.LINK_REFUSED: seen.links_refused,
            RefusalCode.UNKNOWN_NAME: seen.unknown_names,
        }

    def _may_record(self) -> bool:
        now_s = self._clock.monotonic_s()
        self._left = min(self._left + (now_s - self._counted_at_s) / ONE_MORE_AFTER_S, float(MOST_AT_ONCE))
        self._counted_at_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


def summary(report: BusRefusals | None) -> str:
    """What was refused, in a sentence for people."""
    if report is None:
        return "the router has not reported what it refuses"
    newest = max(report.newest, key=lambda entry: entry.last_at_ns, default=None)
    counted = (
        f"since its start the router denied {report.messages_denied} messages, refused {report.links_refused} links "
        f"and met {report.unknown_names} unknown names"
    )
    if newest is None:
        return counted
    return f"{counted}; the newest: {_described(newest)}"


def _described(entry: BusRefusal) -> str:
    if entry.service:
        return f"{entry.service}, {entry.what} {entry.key}".rstrip()
    return f"a link ({entry.what})"


def _sender(entry: BusRefusal) -> _Sender:
    return entry.code, entry.service, entry.what, entry.key


def _named(entry: BusRefusal) -> RefusedOnBus:
    return RefusedOnBus(entry.code.value, entry.service, entry.what, entry.key, entry.times, entry.last_at_ns)
