"""`/events` and `/cases/{id}/events`: the log as a stream of server-sent events, resumable by `Last-Event-ID`."""

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated, Any, Final

from fastapi import Header, Query
from sse_starlette import EventSourceResponse, ServerSentEvent

from services.ui_api.core.identity import User
from services.ui_api.core.roles import Action
from services.ui_api.handlers.event_tail import News, TailEvent
from services.ui_api.record.record import PAGE, CaseRecord
from services.ui_api.routes.access import TheGateway
from services.ui_api.routes.awakening import Awakening
from services.ui_api.routes.guards import TheUser, needs
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.views import EventView
from services.ui_api.service import Gateway

router = resource_router(tag="events")
# Chosen: below the 30 s after which proxies close what says nothing.
PING_S = 10.0
# Chosen: about the time of a restart, after which a client that connects again finds the gateway.
RETRY_MS: Final = 3000
_STREAM: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "Server-sent events; docs/asyncapi.json has the schema of each kind.",
        "content": {"text/event-stream": {"schema": {"type": "string"}}},
    }
}
LastEventId = Annotated[
    str | None, Header(alias="Last-Event-ID", pattern=r"^[0-9]{1,18}$", description="Id of the last event received.")
]
After = Annotated[int | None, Query(ge=0, lt=10**18, description="Sequence number after which to begin.")]


@router.get("/events", response_class=EventSourceResponse, responses=_STREAM, openapi_extra=needs(Action.READ))
async def all_events(
    gateway: TheGateway, user: TheUser, last_event_id: LastEventId = None, after: After = None
) -> EventSourceResponse:
    """All events. Without `Last-Event-ID` and `after`: those to come."""
    start = _start(last_event_id, after, gateway.record.ledger.head_sequence)
    return EventSourceResponse(_stream(gateway, user, start, None), ping=PING_S)


@router.get(
    "/cases/{case_id}/events", response_class=EventSourceResponse, responses=_STREAM, openapi_extra=needs(Action.READ)
)
async def case_events(
    case_id: str, gateway: TheGateway, user: TheUser, last_event_id: LastEventId = None, after: After = None
) -> EventSourceResponse:
    """The events of a case. Without `Last-Event-ID` and `after`: from its beginning."""
    gateway.cases.case(case_id)
    return EventSourceResponse(_stream(gateway, user, _start(last_event_id, after, 0), case_id), ping=PING_S)


def _start(last_event_id: str | None, after: int | None, otherwise: int) -> int:
    if last_event_id is not None:
        return int(last_event_id)
    return otherwise if after is None else after


async def _stream(gateway: Gateway, user: User, start: int, case_id: str | None) -> AsyncIterator[ServerSentEvent]:
    """Read the log from `start`, wait until it grows, and go on, until gateway, session or client end."""
    grown, place = Awakening(), start
    with gateway.feed.listening(grown.call):
        while True:
            await gateway.acting.nobody()
            grown.clear()  # before anything is looked at: an end that comes after the look wakes the stream
            if gateway.feed.closed or not gateway.access.still_admits(user):
                break
            news = gateway.tail.after(place)
            if news is None:  # the client is far behind: it catches up from the database
                news = await asyncio.to_thread(_page, gateway.record, place, case_id)
            for one in news.events:
                if case_id in (None, one.event.case_id):
                    yield _sent(one)
            place = news.through
            if place >= gateway.record.ledger.head_sequence:
                await grown.wait()
    if gateway.feed.closed:
        yield ServerSentEvent(comment="the gateway ends or restarts", retry=RETRY_MS)


def _page(record: CaseRecord, place: int, case_id: str | None) -> News:
    """A page of the log: up to its last event, or to the log's end as it was before, if the page is not full."""
    end = record.ledger.head_sequence
    events = record.events_after(place, case_id)
    last = events[-1].sequence if events else place
    return News(tuple(TailEvent(event) for event in events), last if len(events) == PAGE else max(last, end))


def _sent(one: TailEvent) -> ServerSentEvent:
    event = one.event
    return ServerSentEvent(one.rendered(EventView.json_of), event=event.kind, id=str(event.sequence))
