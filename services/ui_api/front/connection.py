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
from services.ui_api.front.application_socket import ApplicationConnections, ApplicationGone
from services.ui_api.front.client_stream import READS_WITHIN_S, ClientStream
from services.ui_api.front.deadline import Deadline
from services.ui_api.front.handover import Handover
from services.ui_api.front.heads import RequestHead, Sender
from services.ui_api.front.incoming import Incoming
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
# A body that a stop brings along is read and forgotten; what is longer costs the connection.
_MOST_STOP_BODY_BYTES: Final = 64 * 1024
# Chosen: for the rest of a request that was answered already; whoever has read that closes.
_REST_WITHIN_S: Final = 2.0
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
    reads_within_s: float = READS_WITHIN_S
    leaving: Leaving = field(default_factory=Leaving)


class Connection:
    """Serves one connection until either side ends it."""

    def __init__(self, parts: FrontParts, stream: ClientStream) -> None:
        self._parts, self._stream = parts, stream
        self._place = Place(stream.abort)
        self._deadline = Deadline(self._too_late)
        self._ahead: Stop | None = None
        self._in_head = False
        peer = stream.transport.get_extra_info("peername")
        self._peer = str(peer[0]) if peer else "unknown"
        # Who has left already has no address any more; his stop still goes out.
        self._is_in_room = peer is None or is_in_networks(self._peer, parts.room_networks)
        sender = Sender(self._peer, parts.scheme)
        self._incoming = Incoming(stream, sender, self._head_begun, self._look_ahead)
        self._client = Client(stream, self._incoming, self._look_ahead)

    async def serve(self) -> None:
        """Answer requests one after another."""
        admission = self._parts.admission
        admission.enter(self._place)
        try:
            await self._answer_all()
            await self._take_what_still_comes()
        except OSError:
            pass  # the client has gone, or reads nothing
        except asyncio.CancelledError:
            self._stream.abort()  # the front ends: nobody waits until a slow client has read its answer
            raise
        finally:
            self._deadline.end()
            admission.leave(self._place)
            self._stream.close()

    async def _answer_all(self) -> None:
        """Answer until the client has left, or an answer was the connection's last."""
        admission = self._parts.admission
        try:
            while (head := await self._next_head()) is not None:
                admission.busy(self._place)
                if not await self._answer(head):
                    return
                admission.idle(self._place)
        except h11.RemoteProtocolError as error:
            detail = f"the request cannot be read: {error}"
            _log.warning("request refused: request_invalid: %s (from %s)", detail, self._peer)
            asked = Asked("", self._parts.scheme, keeps_open=False)
            self._stream.write(problem_answer(error.error_status_hint, "request_invalid", detail, asked))

    async def _take_what_still_comes(self) -> None:
        """Of a request that was answered before it was whole, read the rest and forget it.

        The system resets a connection that is closed while its client still sends, and the client may lose the answer.
        """
        if self._incoming.is_whole:
            return
        self._parts.admission.idle(self._place)
        self._deadline.end()
        rest = Deadline(self._stream.close)  # no abort: who reads slowly may still wait for the answer itself
        rest.set(_REST_WITHIN_S)
        self._stream.end_writing()
        try:
            while await self._stream.read():
                pass
        finally:
            rest.end()

    async def _next_head(self) -> RequestHead | None:
        """The head of the next request; None when the client has left."""
        self._deadline.set(self._parts.idle_for_s * random.uniform(_SHORTEST_IDLE, 1.0))
        head = await self._incoming.next_head()
        self._deadline.clear()
        self._in_head = False
        return head

    def _head_begun(self) -> None:
        if not self._in_head:
            self._in_head = True
            self._deadline.set(self._parts.head_within_s)

    def _too_late(self) -> None:
        if self._in_head:
            limit_s = self._parts.head_within_s
            _log.warning("head_too_slow: no whole request within %g s (from %s)", limit_s, self._peer)
        self._stream.abort()

    def _look_ahead(self) -> None:
        """A stop among what was sent ahead goes out at once, in whatever order."""
        if self._is_in_room and self._ahead is None and any(head.is_stop for head in self._incoming.requests_ahead()):
            self._ahead = self._parts.stops.begin()

    async def _answer(self, head: RequestHead) -> bool:
        """Answer a request; whether the connection can take another one."""
        if self._is_in_room and head.is_stop:
            return await self._stop(head)
        if self._parts.leaving.has_begun:
            return self._refuse(head, "gateway_leaving", DETAIL, AGAIN)
        if self._parts.handover is not None and head.is_stream and self._handed_over(self._parts.handover, head):
            return False
        if not self._parts.admission.take_relay():
            most = self._parts.admission.limits.relays
            detail = f"the gateway works on {most} requests at once, which is its limit; try again, or end some"
            return self._refuse(head, "gateway_busy", detail)
        try:
            return await Relay(self._client, self._parts.application).carry(head)
        except ApplicationGone as error:
            detail = f"the gateway's application does not answer ({error or 'it starts, or has ended'}); try again"
            return self._refuse(head, "application_unavailable", detail)
        finally:
            self._parts.admission.end_relay()

    def _handed_over(self, handover: Handover, head: RequestHead) -> bool:
        """Let the application have the connection; False when it cannot: then the stream is relayed, or refused."""
        if not self._parts.admission.has_place_for_stream():
            return False
        if not self._incoming.is_whole or self._incoming.ahead:
            return False  # what comes behind may be a stop
        if not handover.give(self._stream.transport.get_extra_info("socket"), head.forwarded):
            return False
        self._stream.abort()  # this process's handle alone
        return True

    def _refuse(
        self, head: RequestHead, code: str, detail: str, again: Mapping[str, str] = MappingProxyType(_AGAIN)
    ) -> bool:
        """Answer 503, and end the connection: its body need not be read."""
        self._stream.write(problem_answer(503, code, detail, self._asked(head, keeps_open=False), again))
        return False

    def _asked(self, head: RequestHead, *, keeps_open: bool) -> Asked:
        return Asked(head.path, self._parts.scheme, keeps_open)

    async def _stop(self, head: RequestHead) -> bool:
        stop, self._ahead = self._ahead or self._parts.stops.begin(), None
        outcome = await asyncio.wrap_future(stop.outcome)
        recorded, _ = await asyncio.wait([asyncio.wrap_future(stop.recorded)], timeout=RECORD_WITHIN_S)
        keeps_open = head.stays_open
        asked = self._asked(head, keeps_open=keeps_open)
        self._stream.write(stop_answer(outcome, asked, recorded=bool(recorded)))
        await self._stream.drain()
        return keeps_open and await self._forget_body()

    async def _forget_body(self) -> bool:
        """Read what a stop brought along; whether it was short enough."""
        forgotten_bytes = 0
        while not self._incoming.is_whole:
            forgotten_bytes += sum(map(len, self._incoming.body_pieces()))
            if forgotten_bytes > _MOST_STOP_BODY_BYTES or self._incoming.client_waits_to_go_on:
                return False
            if not (self._incoming.is_whole or await self._incoming.receive_body()):
                return False
        return True
