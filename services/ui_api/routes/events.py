"""`/events` and `/cases/{id}/events`: the log as a stream of server-sent events, resumable by `Last-Event-ID`."""

import asyncio
import http
from typing import Annotated, Any, Final

from fastapi import Header, Query
from fastapi.responses import Response
from starlette.types import Receive, Scope, Send

from services.ui_api.core.identity import User
from services.ui_api.core.roles import Action
from services.ui_api.outlet import outlet_of
from services.ui_api.routes.access import TheGateway
from services.ui_api.routes.event_followers import EventFollower, page_after, text_of
from services.ui_api.routes.guards import TheUser, needs
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.streams import Streams
from services.ui_api.service import Gateway

router = resource_router(tag="events")
_HEADERS: Final = {"cache-control": "no-store", "x-accel-buffering": "no"}
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


class EventStream(Response):
    """An answer that goes on until gateway, session or client end.

    Parameters
    ----------
    start
        Sequence number after which to begin.
    case_id
        Whose events; None for all.
    status_code
        The framework reads it off here for the API document.
    """

    media_type = "text/event-stream"

    def __init__(
        self, gateway: Gateway, user: User, start: int, case_id: str | None, status_code: int = http.HTTPStatus.OK
    ) -> None:
        super().__init__(status_code=status_code, headers=_HEADERS)
        del self.headers["content-length"]
        self._gateway, self._user, self._start, self._case_id = gateway, user, start, case_id

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, and follow the log."""
        del receive  # nothing more is asked; that the client leaves, its connection says
        await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
        await send({"type": "http.response.body", "body": b"", "more_body": True})
        streams: Streams = scope["app"].state.streams
        followers = streams.here().followers
        follower = EventFollower(
            outlet_of(scope), self._user, self._case_id, self._start, self._gateway.clock.monotonic_s()
        )

        def note_change() -> None:
            if follower.outlet.is_closing:
                follower.end()
            followers.look()

        follower.outlet.lend(note_change)
        with followers.joined(follower):
            while not follower.is_over:
                await follower.news.wait()
                follower.news.clear()
                await self._catch_up(follower)
                followers.look()
        if follower.outlet.backlog_bytes:
            follower.outlet.abort()  # who does not read what was sent is not waited for
        await send({"type": "http.response.body", "body": b""})

    async def _catch_up(self, follower: EventFollower) -> None:
        """From the database, a page at a time, until the newest events in memory go on from there."""
        gateway = self._gateway
        while follower.is_far_behind and follower.reads:
            page = await asyncio.to_thread(page_after, gateway.record, follower.place, follower.case_id)
            if follower.reads:
                follower.write(text_of(page, follower.case_id), gateway.clock.monotonic_s())
                follower.place = page.through
            follower.is_far_behind = gateway.tail.after(follower.place) is None
        follower.is_far_behind = False


@router.get("/events", response_class=EventStream, responses=_STREAM, openapi_extra=needs(Action.READ))
async def all_events(
    gateway: TheGateway, user: TheUser, last_event_id: LastEventId = None, after: After = None
) -> Response:
    """All events. Without `Last-Event-ID` and `after`: those to come."""
    head = gateway.record.ledger.head_sequence
    return EventStream(gateway, user, _start(last_event_id, after, head, head), None)


@router.get("/cases/{case_id}/events", response_class=EventStream, responses=_STREAM, openapi_extra=needs(Action.READ))
async def case_events(
    case_id: str, gateway: TheGateway, user: TheUser, last_event_id: LastEventId = None, after: After = None
) -> Response:
    """The events of a case. Without `Last-Event-ID` and `after`: from its beginning."""
    gateway.cases.case(case_id)
    return EventStream(gateway, user, _start(last_event_id, after, 0, gateway.record.ledger.head_sequence), case_id)


def _start(last_event_id: str | None, after: int | None, otherwise: int, head: int) -> int:
    """Where to begin: not beyond the log's end, where it has gone back to that of an older backup."""
    if last_event_id is not None:
        return min(int(last_event_id), head)
    return otherwise if after is None else min(after, head)
