"""Guidance over REST and over `WS /live`: the newest word with its age, never an older one in its place."""

import asyncio
import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from starlette.types import Message
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from services.ui_api.app import make_app
from services.ui_api.core.roles import Role
from services.ui_api.routes.live_viewers import SERVICE_RESTART
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.people import add_account, end_session_of, tokens_of
from tests.unit.services.ui_api.room import TOKEN, Room, wait_until


def heard(room: Room, say: Callable[[], None]) -> None:
    """Wait until the gateway has noticed something live."""
    noticed = threading.Event()
    with room.gateway.live.feed.listening(noticed.set):
        say()
        assert noticed.wait(PATIENCE_S)


def test_alignment_tells_the_newest_word_and_its_frame(room: Room) -> None:
    case_id = room.open_case()
    image = room.image("one", case_id)
    assert room.get(f"/cases/{case_id}/alignment").json()["guidance"] is None
    heard(room, lambda: room.registration.guide(image, 1.5))
    guidance = room.get(f"/cases/{case_id}/alignment").json()["guidance"]
    assert guidance["image"]["sha256"] == image.sha256
    assert guidance["c_arm_correction_deg"] == {"about_image_x": 1.5, "about_image_y": 0.0}
    assert guidance["validity"] == "current"
    assert guidance["age_s"] >= 7.5  # what the frame's age was, and the time since: the wall clock is not asked


@pytest.mark.requirement("REG-13")
def test_a_word_about_an_old_frame_is_stale_as_soon_as_there_is_a_newer_image(room: Room) -> None:
    case_id = room.open_case()
    image = room.image("one", case_id)
    heard(room, lambda: room.registration.guide(image, 1.5))
    room.image("two", case_id)
    guidance = room.get(f"/cases/{case_id}/alignment").json()["guidance"]
    assert guidance["validity"] == "stale"
    assert "newer images have come" in guidance["stale_because"]


@pytest.mark.requirement("OPS-02")
@pytest.mark.parametrize("stepped_s", [0, 3, -3, 3600, -3600])
def test_an_older_frame_that_took_longer_does_not_replace_a_newer_one_whatever_the_clock_says(
    room: Room, stepped_s: int
) -> None:
    case_id = room.open_case()
    first, second = room.image("one", case_id), room.image("two", case_id)
    first = first.model_copy(update={"received_at_ns": 10**15})
    second = second.model_copy(update={"received_at_ns": 10**15 + stepped_s * 10**9})
    live, told, last = room.gateway.live, list[float](), threading.Event()

    def note() -> None:
        word = live.guidance(case_id)
        assert word is not None
        assert word.guidance.holes is not None
        told.append(word.guidance.holes[0].about_image_x)
        if told[-1] == 0.4:
            last.set()

    with live.feed.listening(note):
        for image, about_image_x_deg in ((second, 0.3), (first, 1.5), (second, 0.4)):
            room.registration.guide(image, about_image_x_deg)
        assert last.wait(PATIENCE_S)
    assert told == [0.3, 0.4]


@contextmanager
def viewer(room: Room, token: str = TOKEN, origin: str | None = None) -> Iterator[ClientConnection]:
    """Somebody who watches."""
    address = f"{room.client.base_url}/api/v1/live".replace("http", "ws", 1)
    headers = {"Authorization": f"Bearer {token}", **({} if origin is None else {"Origin": origin})}
    with connect(address, additional_headers=headers, compression=None, open_timeout=PATIENCE_S) as connection:
        yield connection


def ended_with(connection: ClientConnection) -> tuple[int, str]:
    """Code and reason with which the gateway has ended it; nothing else may come before."""
    with pytest.raises(ConnectionClosed) as raised:
        connection.recv(PATIENCE_S)
    assert raised.value.rcvd is not None
    return raised.value.rcvd.code, raised.value.rcvd.reason


def test_a_viewer_gets_the_newest_image_with_guidance_and_may_leave(room: Room) -> None:
    case_id = room.open_case()
    image = room.image("one", case_id)
    heard(room, lambda: room.registration.guide(image, 1.5))
    with viewer(room) as connection:
        text, picture = (connection.recv(PATIENCE_S) for _ in range(2))
    view = json.loads(text)
    assert (view["image"], view["case_id"], view["picture"]) == (image.sha256, case_id, "image/jpeg")
    assert view["guidance"]["c_arm_correction_deg"]["about_image_x"] == 1.5
    assert isinstance(picture, bytes)
    assert picture.startswith(b"\xff\xd8")
    wait_until(lambda: room.gateway.live.viewers == 0)


def test_a_word_of_guidance_alone_brings_no_second_picture(room: Room) -> None:
    case_id = room.open_case()
    image = room.image("one", case_id)
    with viewer(room) as connection:
        assert json.loads(connection.recv(PATIENCE_S))["guidance"] is None
        assert isinstance(connection.recv(PATIENCE_S), bytes)
        room.registration.guide(image, 1.5)
        view = json.loads(connection.recv(PATIENCE_S))
    assert (view["picture"], view["image"]) == (None, image.sha256)
    assert view["guidance"]["c_arm_correction_deg"]["about_image_x"] == 1.5


def test_viewers_are_told_to_come_again_when_the_gateway_ends(room: Room) -> None:
    room.gateway.live.feed.close()
    with viewer(room) as connection:
        assert ended_with(connection)[0] == SERVICE_RESTART


def test_a_viewer_whose_session_ends_while_the_picture_waits_for_somebody_who_acts_sees_no_more(room: Room) -> None:
    case_id = room.open_case()
    image = room.image("one", case_id)
    heard(room, lambda: room.registration.guide(image, 1.5))
    add_account(room, "nora", Role.TECHNICIAN)
    token, acting = tokens_of(room, "nora").access_token, room.gateway.acting
    acting.begin()
    with viewer(room, token) as connection:
        wait_until(lambda: acting.waiting > 0)
        end_session_of(room, token)
        acting.end()
        assert ended_with(connection) == (1008, "session_ended")


def test_a_viewer_who_is_stuck_keeps_no_other_from_the_newest_picture(room: Room) -> None:
    """He gets what fits into the system's buffers, and afterwards the newest picture alone."""
    case_id = room.open_case()
    with viewer(room) as stuck, viewer(room) as other:
        stuck.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        sent = [room.image(f"image {number}", case_id).sha256 for number in range(3)]
        shown = ""
        while shown != sent[-1]:
            message = other.recv(PATIENCE_S)
            shown = json.loads(message)["image"] if isinstance(message, str) else shown


HERE = (b"host", b"localhost:8000")
SIGNED_IN = (b"authorization", f"Bearer {TOKEN}".encode())


async def _answer_to(room: Room, headers: tuple[tuple[bytes, bytes], ...]) -> Message:
    """What somebody is told who asks to watch and is refused."""
    sent: asyncio.Queue[Message] = asyncio.Queue()

    async def receive() -> Message:
        return {"type": "websocket.connect"}

    scope = {
        "type": "websocket",
        "path": "/api/v1/live",
        "raw_path": b"/api/v1/live",
        "query_string": b"",
        "headers": list(headers),
        "subprotocols": [],
        "scheme": "ws",
    }
    await asyncio.wait_for(make_app(room.gateway)(scope, receive, sent.put), PATIENCE_S)
    return sent.get_nowait()


@pytest.mark.requirement("SEC-03")
def test_another_page_may_not_watch(room: Room) -> None:
    from_elsewhere = (HERE, SIGNED_IN, (b"origin", b"https://elsewhere.example"))
    answer = asyncio.run(_answer_to(room, from_elsewhere))
    assert (answer["type"], answer["code"]) == ("websocket.close", 1008)
    with viewer(room, origin=str(room.client.base_url).rstrip("/")):
        pass


def test_nobody_watches_without_being_signed_in(room: Room) -> None:
    answer = asyncio.run(_answer_to(room, (HERE,)))
    assert (answer["type"], answer["code"], answer["reason"]) == ("websocket.close", 1008, "token_missing")
