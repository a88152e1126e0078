"""Followers of the log: what is new is one piece of text for all who are at the same place in it."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from sse_starlette import ServerSentEvent

from services.ui_api.core.identity import User
from services.ui_api.handlers.event_tail import News, TailEvent
from services.ui_api.outlet import Outlet
from services.ui_api.record.record import PAGE, CaseRecord
from services.ui_api.routes.audience import Programme
from services.ui_api.routes.views import EventView
from services.ui_api.service import Gateway

# Chosen: with the time between two looks below the 30 s after which proxies close what says nothing.
PING_S: Final = 10.0
# Chosen: about the time of a restart, after which a client that connects again finds the gateway.
RETRY_MS: Final = 3000
_PING: Final = ServerSentEvent(comment="ping").encode()
_GATEWAY_ENDS: Final = ServerSentEvent(comment="the gateway ends or restarts", retry=RETRY_MS).encode()


@dataclass(eq=False, slots=True)
class EventFollower:
    """One client.

    Attributes
    ----------
    case_id
        Whose events; None for all.
    place
        Sequence number up to which he has got them.
    is_far_behind
        Whether he must catch up from the database first.
    is_over
        Whether it ends, by him or by the gateway.
    news
        Set when one of these two has become true.
    """

    outlet: Outlet
    user: User
    case_id: str | None
    place: int
    wrote_s: float = 0.0
    is_far_behind: bool = False
    is_over: bool = False
    news: asyncio.Event = field(default_factory=asyncio.Event)

    def end(self) -> None:
        """It is over."""
        self.is_over = True
        self.news.set()

    def fall_behind(self) -> None:
        """Let him catch up."""
        self.is_far_behind = True
        self.news.set()

    def write(self, content: bytes, now_s: float) -> None:
        """Send, where there is something."""
        if content:
            self.outlet.write(content)
            self.wrote_s = now_s

    @property
    def reads(self) -> bool:
        """Whether he has got everything that was written so far, and wants more."""
        return not (self.is_over or self.outlet.is_closing or self.outlet.backlog_bytes)


def event_programme(gateway: Gateway) -> Programme[EventFollower]:
    """The log as it grows."""
    return Programme("event followers", gateway.feed.listening, lambda: _round(gateway))


def _round(gateway: Gateway) -> Callable[[EventFollower], None]:
    newest = _Newest(gateway.tail.after)
    now_s = gateway.clock.monotonic_s()

    def serve(follower: EventFollower) -> None:
        if gateway.feed.closed:
            follower.write(_GATEWAY_ENDS if follower.reads else b"", now_s)
            follower.end()
        elif not gateway.access.still_admits(follower.user):
            follower.end()
        elif follower.reads and not follower.is_far_behind:
            _bring_up(follower, newest, now_s)

    return serve


def _bring_up(follower: EventFollower, newest: "_Newest", now_s: float) -> None:
    text = newest.after(follower.place, follower.case_id)
    if text is None:
        follower.fall_behind()
        return
    content, follower.place = text
    follower.write(content, now_s)
    if now_s - follower.wrote_s > PING_S:
        follower.write(_PING, now_s)


class _Newest:
    """What came after a place, as text, made once in each round."""

    def __init__(self, after: Callable[[int], News | None]) -> None:
        self._after = after
        self._texts: dict[tuple[int, str | None], tuple[bytes, int] | None] = {}

    def after(self, place: int, case_id: str | None) -> tuple[bytes, int] | None:
        """The text, and the place up to which it goes; None when that is no longer kept."""
        if (place, case_id) not in self._texts:
            news = self._after(place)
            self._texts[place, case_id] = None if news is None else (text_of(news, case_id), news.through)
        return self._texts[place, case_id]


def text_of(news: News, case_id: str | None) -> bytes:
    """Events as they go over the wire."""
    return b"".join(_sent(one) for one in news.events if case_id in (None, one.event.case_id))


def page_after(record: CaseRecord, place: int, case_id: str | None) -> News:
    """A page of the log: up to its last event, or to the log's end as it was before, if the page is not full."""
    end = record.ledger.head_sequence
    events = record.events_after(place, case_id)
    last = events[-1].sequence if events else place
    return News(tuple(TailEvent(event) for event in events), last if len(events) == PAGE else max(last, end))


def _sent(one: TailEvent) -> bytes:
    event = one.event
    return ServerSentEvent(one.rendered(EventView.json_of), event=event.kind, id=str(event.sequence)).encode()
