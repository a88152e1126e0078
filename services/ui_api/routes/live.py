"""`WS /live`: the newest image and the newest guidance for a viewer. Nobody waits for a slow one: it misses frames."""

import asyncio
from typing import Final, Literal

from fastapi import WebSocket, WebSocketDisconnect

from services.ui_api.core.roles import Action
from services.ui_api.handlers.live import HeardGuidance, LiveFrame, LiveHandler
from services.ui_api.routes.awakening import Awakening
from services.ui_api.routes.guards import POLICY_VIOLATION, guarded_websocket
from services.ui_api.routes.result_views import GuidanceView, aged
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.views import View
from services.ui_api.service import Gateway
from shared.messages.base import Identifier, Sha256, UnixNanoseconds
from shared.messages.imaging import FrameHeader

router = resource_router(tag="live")
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


@router.websocket("/live")
@guarded_websocket(Action.READ)
async def watch(socket: WebSocket) -> None:
    """Send every new frame that the viewer keeps up with: a text message (`LiveView`), then the picture as JPEG."""
    gateway: Gateway = socket.app.state.gateway
    await socket.accept()
    news = Awakening()
    leaving = asyncio.create_task(_left(socket))
    leaving.add_done_callback(lambda _: news.call())
    # The feed also wakes when a session was ended.
    with gateway.live.watching(news.call), gateway.feed.listening(news.call):
        try:
            await _send_on(socket, gateway, news, leaving)
            if gateway.live.feed.closed:
                await socket.close(SERVICE_RESTART, _GATEWAY_ENDS)
            elif not leaving.done():
                await socket.close(POLICY_VIOLATION, _SESSION_ENDED)
        except WebSocketDisconnect:
            pass  # it left while something was sent
        finally:
            leaving.cancel()


async def _send_on(socket: WebSocket, gateway: Gateway, news: Awakening, leaving: "asyncio.Task[None]") -> None:
    live = gateway.live
    shown: tuple[LiveFrame | None, HeardGuidance | None] = (None, None)
    while True:
        await gateway.acting.nobody()
        news.clear()  # before anything is looked at: an end that comes after the look wakes the stream
        if live.feed.closed or leaving.done() or not gateway.access.still_admits(socket.state.user):
            return
        frame = live.frame
        heard = None if frame is None else live.guidance(frame.header.case_id)
        if frame is not None and (frame, heard) != shown:
            fresh = frame is not shown[0]
            await socket.send_text(_view(live, frame, heard, "image/jpeg" if fresh else None))
            if fresh:
                await socket.send_bytes(frame.jpeg)
            shown = (frame, heard)
        else:
            await news.wait()


def _view(
    live: LiveHandler, frame: LiveFrame, heard: HeardGuidance | None, picture: Literal["image/jpeg"] | None
) -> str:
    header = frame.header
    view = LiveView(
        image=header.sha256,
        sequence=header.sequence,
        received_at_ns=header.received_at_ns,
        age_s=aged(header.age_s, live.heard_s_ago(frame)),
        case_id=header.case_id,
        picture=picture,
        guidance=None if heard is None else _guidance(live, header, heard),
    )
    return view.model_dump_json(by_alias=True)


def _guidance(live: LiveHandler, header: FrameHeader, heard: HeardGuidance) -> GuidanceView:
    """The word beside a picture: of the same case's set-up as the picture, or stale."""
    return GuidanceView.of(heard.guidance, live.heard_s_ago(heard), header.sha256, header.case_revision)


async def _left(socket: WebSocket) -> None:
    """Ends when the viewer leaves; what it sends is ignored."""
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass
