"""`/virtual-room/`: the virtual operating room's control API, passed on to the console that a simulation shows.

It is no part of the product: without a simulation there is no such address. It passes through the gateway so that the
page needs no other address, and so that only somebody who is signed in has hands in the virtual room.
"""

import http.client
from dataclasses import dataclass
from typing import Final
from urllib.parse import quote, urlsplit

from fastapi import Request, Response
from fastapi.concurrency import run_in_threadpool

from services.ui_api.core.roles import Action
from services.ui_api.handlers.refusals import RefusalKind, Refused
from services.ui_api.routes.guards import needs
from services.ui_api.routes.routers import page_router

router = page_router("/virtual-room")
# A run of fluoroscopy lasts as long as the pedal is held: at most 120 images.
_ANSWER_WITHIN_S: Final = 60.0
_JSON: Final = "application/json"


@dataclass(frozen=True, slots=True)
class VirtualRoom:
    """Where the virtual operating room listens."""

    url: str

    def answer(self, method: str, path: str, content: bytes) -> Response:
        """Pass a request on; raises `Refused` when the room does not answer."""
        connection = http.client.HTTPConnection(urlsplit(self.url).netloc, timeout=_ANSWER_WITHIN_S)
        try:
            connection.request(method, f"/{quote(path)}", content or None, {"Content-Type": _JSON} if content else {})
            answer = connection.getresponse()
            return Response(answer.read(), answer.status, media_type=answer.headers.get("Content-Type", _JSON))
        except (OSError, http.client.HTTPException) as error:
            raise Refused(
                RefusalKind.UNAVAILABLE,
                "virtual_room_absent",
                f"the virtual room at {self.url} does not answer ({error}); start it, or the simulation anew",
            ) from None
        finally:
            connection.close()


@router.get("/{path:path}", response_class=Response, openapi_extra=needs(Action.READ))
def look(path: str, request: Request) -> Response:
    """What is to be seen in the room: the C-arm, wires, drills, faults, and the truth."""
    return _room(request).answer(request.method, path, b"")


@router.api_route(
    "/{path:path}",
    methods=["POST", "PUT", "DELETE"],
    response_class=Response,
    openapi_extra=needs(Action.RECORD_STEP),
)
async def touch(path: str, request: Request) -> Response:
    """What people's hands do in the room."""
    room, content = _room(request), await request.body()
    return await run_in_threadpool(room.answer, request.method, path, content)


def _room(request: Request) -> VirtualRoom:
    room: VirtualRoom | None = request.app.state.virtual_room
    if room is None:
        raise Refused(RefusalKind.UNKNOWN, "not_found", "there is no virtual room here: this is no simulation")
    return room
