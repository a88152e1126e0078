"""`WS /live`: the newest image and the newest guidance for a viewer. Nobody waits for a slow one: it misses frames."""

import asyncio

from fastapi import WebSocket, WebSocketDisconnect

from services.ui_api.core.roles import Action
from services.ui_api.outlet import outlet_of
from services.ui_api.routes.guards import guarded_websocket
from services.ui_api.routes.live_viewers import Viewer
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.streams import Streams

router = resource_router(tag="live")


@router.websocket("/live")
@guarded_websocket(Action.READ)
async def watch(socket: WebSocket) -> None:
    """Send every new frame that the viewer keeps up with: a text message (`LiveView`), then the picture as JPEG."""
    streams: Streams = socket.app.state.streams
    await socket.accept()
    viewers = streams.here().viewers
    viewer = Viewer(outlet_of(socket.scope), socket.state.user)
    viewer.outlet.lend(viewers.look)
    leaving = asyncio.create_task(_left(socket))
    leaving.add_done_callback(lambda _: viewer.over.set())
    try:
        with viewers.joined(viewer):
            await viewer.over.wait()
        if viewer.outlet.backlog_bytes:
            viewer.outlet.abort()  # who does not read what was sent is not waited for
        elif viewer.why is not None:
            await socket.close(*viewer.why)
    except WebSocketDisconnect:
        pass  # it left meanwhile
    finally:
        leaving.cancel()


async def _left(socket: WebSocket) -> None:
    """Ends when the viewer leaves; what it sends is ignored."""
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass
