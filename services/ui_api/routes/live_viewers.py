"""Viewers of the live picture: each new picture, and each new word of guidance, is one message for all of them."""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final, Literal

from websockets.frames import Frame, Opcode

from services.ui_api.core.identity import User
from services.ui_api.handlers.live import HeardGuidance, LiveFrame, LiveHandler
from services.ui_api.outlet import Outlet
from services.ui_api.routes.audience import Programme
from services.ui_api.routes.guards import POLICY_VIOLATION
from services.ui_api.routes.result_views import GuidanceView, aged
from services.ui_api.routes.views import View
from services.ui_api.service import Gateway
from shared.messages.base import Identifier, Sha256, UnixNanoseconds
from shared.messages.imaging import FrameHeader

# Status code of https://www.iana.org/assignments/websocket/: the client may connect again after some seconds.
SERVICE_RESTART: Final = 1012
_GATEWAY_ENDS: Final = "the gateway ends or restarts; connect again in some seconds"
_SESSION_ENDED: Final = "session_ended"


class LiveView(View):
    """A text message. The picture follows it as a binary message, unless only the guidance is new (`picture` null).

    `guidance` may be about an earlier image than the newest one: its `image` and `age_s` say which.
    """

    image: Sha256
    sequence: int
    received_at_ns: UnixNanoseconds
    age_s: float | None
    case_id: Identifier | None
    picture: Literal["image/jpeg"] | None
    guidance: GuidanceView | None


@dataclass(eq=False, slots=True)
class Viewer:
    """One viewer.

    Attributes
    ----------
    shown
        The picture and the word that he got last.
    over
        Set when it ends, by him or by the gateway.
    why
        The code and reason with which the gateway ends it.
    """

    outlet: Outlet
    user: User | None
    shown: tuple[LiveFrame | None, HeardGuidance | None] = (None, None)
    over: asyncio.Event = field(default_factory=asyncio.Event)
    why: tuple[int, str] | None = None

    def end(self, code: int, reason: str) -> None:
        """Send him home."""
        self.why = (code, reason)
        self.over.set()


def live_programme(gateway: Gateway) -> Programme[Viewer]:
    """The newest picture and guidance; also looked at when a session has ended."""

    @contextmanager
    def listening(waker: Callable[[], None]) -> Iterator[None]:
        with gateway.live.watching(waker), gateway.feed.listening(waker):
            yield

    return Programme("live viewers", listening, lambda: _round(gateway))


def _round(gateway: Gateway) -> Callable[[Viewer], None]:
    live = gateway.live
    frame = live.frame
    heard = None if frame is None else live.guidance(frame.header.case_id)
    messages: dict[bool, bytes] = {}

    def serve(viewer: Viewer) -> None:
        if live.feed.closed:
            viewer.end(SERVICE_RESTART, _GATEWAY_ENDS)
        elif not gateway.access.still_admits(viewer.user):
            viewer.end(POLICY_VIOLATION, _SESSION_ENDED)
        elif frame is not None and (frame, heard) != viewer.shown and _reads(viewer):
            fresh = frame is not viewer.shown[0]
            if fresh not in messages:
                messages[fresh] = _message(live, frame, heard, with_picture=fresh)
            viewer.outlet.write(messages[fresh])
            viewer.shown = (frame, heard)

    return serve


def _reads(viewer: Viewer) -> bool:
    """Whether he has got everything so far: who has not misses this one."""
    return not (viewer.over.is_set() or viewer.outlet.is_closing or viewer.outlet.backlog_bytes)


def _message(live: LiveHandler, frame: LiveFrame, heard: HeardGuidance | None, *, with_picture: bool) -> bytes:
    """The text message and the binary one, as they go over the wire."""
    header = frame.header
    view = LiveView(
        image=header.sha256,
        sequence=header.sequence,
        received_at_ns=header.received_at_ns,
        age_s=aged(header.age_s, live.heard_s_ago(frame)),
        case_id=header.case_id,
        picture="image/jpeg" if with_picture else None,
        guidance=None if heard is None else _guidance(live, header, heard),
    )
    frames = [Frame(Opcode.TEXT, view.model_dump_json(by_alias=True).encode())]
    if with_picture:
        frames.append(Frame(Opcode.BINARY, frame.jpeg))
    return b"".join(one.serialize(mask=False) for one in frames)


def _guidance(live: LiveHandler, header: FrameHeader, heard: HeardGuidance) -> GuidanceView:
    """The word beside a picture: of the same case's set-up as the picture, or stale."""
    return GuidanceView.of(heard.guidance, live.heard_s_ago(heard), header.sha256, header.case_revision)
