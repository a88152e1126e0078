"""One client's connection: request after request, a stop answered here, everything else by the application."""

import asyncio
import logging
import random
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

import h11

from services.ui_api.core.networks import PRIVATE_NETWORKS, Network, is_in_networks
from services.ui_api.front.admission import Admission, Place
from services.ui_api.front.answers import Asked, problem_answer, stop_answer
from services.ui_api.front.application_socket import PIECE_BYTES, ApplicationConnections, ApplicationGone
from services.ui_api.front.handover import Handover
from services.ui_api.front.heads import forwarded, is_stop, is_stream, path_of, stays_open
from services.ui_api.front.leaving import AGAIN, DETAIL, Leaving
from services.ui_api.front.relay import Client, Relay
from services.ui_api.front.stops import FrontStops, Stop

_log = logging.getLogger("distalock.ui_api")

RECORD_WITHIN_S: Final = 2.0
# For a whole head, from its first byte.
HEAD_WITHIN_S: Final = 5.0
# For that first byte: a connection that is idle longer is closed, and sooner when others need its place.
IDLE_FOR_S: Final = 60.0
# Each connection waits a share of that, drawn for it: what came all at once must not be closed all at once.
_SHORTEST_IDLE: Final = 0.5
_MOST_HEAD_BYTES: Final = 32 * 1024
_MOST_AHEAD_BYTES: Final = 64 * 1024
# A body that a stop brings along is read and forgotten; what is longer costs the connection.
_MOST_STOP_BODY_BYTES: Final = 64 * 1024
_AGAIN: Final = {"retry-after": "1"}


@dataclass(frozen=True, slots=True)
class FrontParts:
    """What all connections share.

    Attributes
    ----------
    application
        Connections to the application.
    scheme
        ``http``, or ``https`` where TLS ends here.
    room_networks
        From there a stop needs no login. From elsewhere it is the application's business, as every other request.
    handover
        Takes connections that stream; None where TLS ends here, whose keys do not go along: then they are relayed.
    """

    stops: FrontStops
    admission: Admission
    application: ApplicationConnections
    scheme: str
    room_networks: tuple[Network, ...] = PRIVATE_NETWORKS
    handover: Handover | None = None
    head_within_s: float = HEAD_WITHIN_S
    idle_for_s: float = IDLE_FOR_S
    leaving: Leaving = field(default_factory=Leaving)


class Connection:
    """Serves one connection until either side ends it."""

    def __init__(self, parts: FrontParts, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._parts, self._reader, self._writer = parts, reader, writer
        self._place = Place(writer.transport.abort)
        self._parser = h11.Connection(h11.SERVER, max_incomplete_event_size=_MOST_HEAD_BYTES)
        self._ahead: Stop | None = None
        self._in_head = False
        peer = writer.get_extra_info("peername")
        self._peer = str(peer[0]) if peer else "unknown"
        # Who has left already has no address any more; his stop still goes out.
        self._is_in_room = peer is None or is_in_networks(self._peer, parts.room_networks)

    async def serve(self) -> None:
        """Answer requests one after another."""
        admission = self._parts.admission
        admission.enter(self._place)
        try:
            while (request := await self._next_request()) is not None:
                admission.busy(self._place)
                if not await self._answer(request):
                    return
                self._begin_anew()
                admission.idle(self._place)
        except h11.RemoteProtocolError as error:
            detail = f"the request cannot be read: {error}"
            _log.warning("request refused: request_invalid: %s (from %s)", detail, self._peer)
            asked = Asked("", self._parts.scheme, keeps_open=False)
            self._writer.write(problem_answer(error.error_status_hint, "request_invalid", detail, asked))
        except TimeoutError:
            if self._in_head:
                limit_s = self._parts.head_within_s
                _log.warning("head_too_slow: no whole request within %g s (from %s)", limit_s, self._peer)
            self._writer.transport.abort()
        except OSError:
            pass  # the client has gone
        except asyncio.CancelledError:
            self._writer.transport.abort()  # the front ends: nobody waits until a slow client has read its answer
            raise
        finally:
            admission.leave(self._place)
            self._writer.close()

    async def _next_request(self) -> h11.Request | None:
        """The head of the next request; None when the client has left."""
        if not self._parser.trailing_data[0]:
            async with asyncio.timeout(self._parts.idle_for_s * random.uniform(_SHORTEST_IDLE, 1.0)):
                if not await self._received():
                    return None
        self._in_head = True
        async with asyncio.timeout(self._parts.head_within_s):
            while (event := self._parser.next_event()) is h11.NEED_DATA:
                if not await self._received():
                    return None
        self._in_head = False
        return event if isinstance(event, h11.Request) else None

    async def _received(self) -> bool:
        """Read more into the parser; a stop among what was sent ahead goes out at once, in whatever order."""
        content = await self._reader.read(PIECE_BYTES)
        if not content:
            return False
        self._parser.receive_data(content)
        if self._parser.their_state is h11.DONE:
            self._look_ahead()
            while len(self._parser.trailing_data[0]) > _MOST_AHEAD_BYTES:
                await asyncio.sleep(self._parts.head_within_s)  # until the answer that is under way has ended
        return True

    def _look_ahead(self) -> None:
        peek = h11.Connection(h11.SERVER, max_incomplete_event_size=_MOST_AHEAD_BYTES)
        peek.receive_data(self._parser.trailing_data[0])
        try:
            event = peek.next_event()
        except h11.RemoteProtocolError:
            return  # it is answered when it is due
        if self._is_in_room and self._ahead is None and isinstance(event, h11.Request) and is_stop(event):
            self._ahead = self._parts.stops.begin()

    def _begin_anew(self) -> None:
        ahead = self._parser.trailing_data[0]
        self._parser = h11.Connection(h11.SERVER, max_incomplete_event_size=_MOST_HEAD_BYTES)
        if ahead:
            self._parser.receive_data(ahead)

    async def _answer(self, request: h11.Request) -> bool:
        """Answer a request; whether the connection can take another one."""
        if self._is_in_room and is_stop(request):
            return await self._stop(request)
        if self._parts.leaving.has_begun:
            return self._refuse(request, "gateway_leaving", DETAIL, AGAIN)
        if self._parts.handover is not None and is_stream(request) and self._handed_over(self._parts.handover, request):
            return False
        if not self._parts.admission.take_relay():
            most = self._parts.admission.limits.relays
            detail = f"the gateway works on {most} requests at once, which is its limit; try again, or end some"
            return self._refuse(request, "gateway_busy", detail)
        try:
            return await self._relayed(request)
        finally:
            self._parts.admission.end_relay()

    async def _relayed(self, request: h11.Request) -> bool:
        client = Client(self._parser, self._reader, self._writer, self._received)
        relay = Relay(client, self._parts.application)
        try:
            return await relay.carry(request, self._peer, self._parts.scheme, keeps_open=stays_open(request))
        except ApplicationGone as error:
            detail = f"the gateway's application does not answer ({error or 'it starts, or has ended'}); try again"
            return self._refuse(request, "application_unavailable", detail)

    def _handed_over(self, handover: Handover, request: h11.Request) -> bool:
        """Let the application have the connection; False when it cannot: then the stream is relayed, or refused."""
        if not self._parts.admission.has_place_for_stream():
            return False
        while self._parser.next_event() not in (h11.NEED_DATA, h11.PAUSED):
            pass  # the end of a request that has no body
        if self._parser.trailing_data[0]:
            return False  # what comes behind may be a stop
        content = forwarded(request, self._peer, self._parts.scheme)
        if not handover.give(self._writer.get_extra_info("socket"), content):
            return False
        self._writer.transport.abort()  # this process's handle alone
        return True

    def _refuse(
        self, request: h11.Request, code: str, detail: str, again: Mapping[str, str] = MappingProxyType(_AGAIN)
    ) -> bool:
        """Answer 503, and end the connection: its body need not be read."""
        self._writer.write(problem_answer(503, code, detail, self._asked(request, keeps_open=False), again))
        return False

    def _asked(self, request: h11.Request, *, keeps_open: bool) -> Asked:
        return Asked(path_of(request), self._parts.scheme, keeps_open)

    async def _stop(self, request: h11.Request) -> bool:
        stop, self._ahead = self._ahead or self._parts.stops.begin(), None
        outcome = await asyncio.wrap_future(stop.outcome)
        recorded, _ = await asyncio.wait([asyncio.wrap_future(stop.recorded)], timeout=RECORD_WITHIN_S)
        keeps_open = stays_open(request)
        asked = self._asked(request, keeps_open=keeps_open)
        self._writer.write(stop_answer(outcome, asked, recorded=bool(recorded)))
        await self._writer.drain()
        return keeps_open and await self._forget_body()

    async def _forget_body(self) -> bool:
        """Read what a stop brought along; whether it was short enough."""
        forgotten_bytes = 0
        while forgotten_bytes <= _MOST_STOP_BODY_BYTES:
            event = self._parser.next_event()
            if isinstance(event, h11.EndOfMessage):
                return True
            if isinstance(event, h11.Data):
                forgotten_bytes += len(event.data)
            elif self._parser.they_are_waiting_for_100_continue or not await self._received():
                return False
        return False
