"""Guidance over REST and over `WS /live`: the newest word with its age, never an older one in its place."""

import asyncio
import json
import threading
from collections.abc import Callable

import pytest
from starlette.types import Message

from services.ui_api.app import make_app
from services.ui_api.core.roles import Role
from services.ui_api.routes.live import SERVICE_RESTART
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


def test_a_viewer_gets_the_newest_image_with_guidance_and_may_leave(room: Room) -> None:
    case_id = room.open_case()
    image = room.image("one", case_id)
    heard(room, lambda: room.registration.guide(image, 1.5))
    accepted, text, picture = asyncio.run(_watched(room))
    assert accepted["type"] == "websocket.accept"
    view = json.loads(text["text"])
    assert (view["image"], view["case_id"], view["picture"]) == (image.sha256, case_id, "image/jpeg")
    assert view["guidance"]["c_arm_correction_deg"]["about_image_x"] == 1.5
    assert picture["bytes"].startswith(b"\xff\xd8")


def test_viewers_are_told_to_come_again_when_the_gateway_ends(room: Room) -> None:
    room.gateway.live.feed.close()
    accepted, closed = asyncio.run(_watched(room, 2))
    assert accepted["type"] == "websocket.accept"
    assert (closed["type"], closed["code"]) == ("websocket.close", SERVICE_RESTART)


def test_a_viewer_whose_session_ends_while_the_picture_waits_for_somebody_who_acts_sees_no_more(room: Room) -> None:
    case_id = room.open_case()
    image = room.image("one", case_id)
    heard(room, lambda: room.registration.guide(image, 1.5))
    add_account(room, "nora", Role.TECHNICIAN)
    token, acting = tokens_of(room, "nora").access_token, room.gateway.acting

    def end_the_session() -> None:
        wait_until(lambda: acting.waiting > 0)
        end_session_of(room, token)
        acting.end()

    acting.begin()
    ender = threading.Thread(target=end_the_session)
    ender.start()
    accepted, closed = asyncio.run(_watched(room, 2, (HERE, (b"authorization", f"Bearer {token}".encode()))))
    ender.join()
    assert accepted["type"] == "websocket.accept"
    assert (closed["type"], closed["code"], closed["reason"]) == ("websocket.close", 1008, "session_ended")


HERE = (b"host", b"localhost:8000")
SIGNED_IN = (b"authorization", f"Bearer {TOKEN}".encode())


async def _watched(
    room: Room, count: int = 3, headers: tuple[tuple[bytes, bytes], ...] = (HERE, SIGNED_IN)
) -> list[Message]:
    """Connect, take some messages, leave; the application must end by itself then."""
    sent: asyncio.Queue[Message] = asyncio.Queue()
    enough = asyncio.Event()
    incoming: list[Message] = [{"type": "websocket.connect"}]

    async def receive() -> Message:
        if incoming:
            return incoming.pop()
        await enough.wait()
        return {"type": "websocket.disconnect", "code": 1000}

    scope = {
        "type": "websocket",
        "path": "/api/v1/live",
        "raw_path": b"/api/v1/live",
        "query_string": b"",
        "headers": list(headers),
        "subprotocols": [],
        "scheme": "ws",
    }
    served = asyncio.create_task(make_app(room.gateway)(scope, receive, sent.put))
    messages = [await asyncio.wait_for(sent.get(), PATIENCE_S) for _ in range(count)]
    enough.set()
    await asyncio.wait_for(served, PATIENCE_S)
    return messages


@pytest.mark.requirement("SEC-03")
def test_another_page_may_not_watch(room: Room) -> None:
    from_elsewhere = (HERE, SIGNED_IN, (b"origin", b"https://elsewhere.example"))
    (answer,) = asyncio.run(_watched(room, 1, from_elsewhere))
    assert (answer["type"], answer["code"]) == ("websocket.close", 1008)
    own = (HERE, SIGNED_IN, (b"origin", b"http://localhost:8000"))
    (answer,) = asyncio.run(_watched(room, 1, own))
    assert answer["type"] == "websocket.accept"


def test_nobody_watches_without_being_signed_in(room: Room) -> None:
    (answer,) = asyncio.run(_watched(room, 1, (HERE,)))
    assert (answer["type"], answer["code"], answer["reason"]) == ("websocket.close", 1008, "token_missing")
