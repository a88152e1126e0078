"""While somebody acts, pictures and events wait, but not for ever; and what streams keeps no request waiting."""

import asyncio
import threading
import time

import httpx
from starlette.types import Message, Receive, Scope, Send

from services.ui_api.handlers.acting import Acting
from services.ui_api.handlers.event_tail import News
from services.ui_api.routes.acting_first import ActingFirst
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import Room, wait_until


async def _receive() -> Message:
    raise AssertionError("nothing is read")


async def _send(_: Message) -> None:
    raise AssertionError("nothing is answered")


def test_pictures_wait_while_a_request_acts_and_not_while_one_reads() -> None:
    async def run() -> list[str]:
        acting, release, order = Acting(), asyncio.Event(), list[str]()

        async def app(scope: Scope, receive: Receive, send: Send) -> None:
            order.append(f"{scope['method']} begins")
            await release.wait()
            order.append(f"{scope['method']} ends")

        middleware = ActingFirst(app, acting)

        async def show() -> None:
            await acting.nobody()
            order.append("picture")

        reading = asyncio.create_task(middleware({"type": "http", "method": "GET"}, _receive, _send))
        await asyncio.sleep(0.0)
        await show()
        changing = asyncio.create_task(middleware({"type": "http", "method": "POST"}, _receive, _send))
        await asyncio.sleep(0.0)
        showing = asyncio.create_task(show())
        await asyncio.sleep(0.0)
        release.set()
        await asyncio.gather(reading, changing, showing)
        return order

    assert asyncio.run(run()) == ["GET begins", "picture", "POST begins", "GET ends", "POST ends", "picture"]


def test_a_request_that_waits_long_does_not_freeze_the_picture() -> None:
    async def run() -> None:
        acting = Acting()
        acting.begin()
        await asyncio.wait_for(acting.nobody(), 10.0)

    asyncio.run(run())


def test_who_acts_on_another_thread_is_waited_for() -> None:
    acting, waiting = Acting(), threading.Event()
    acting.begin()

    async def run() -> None:
        asyncio.get_running_loop().call_soon(waiting.set)
        await acting.nobody()

    watching = threading.Thread(target=lambda: asyncio.run(asyncio.wait_for(run(), PATIENCE_S)))
    watching.start()
    assert waiting.wait(PATIENCE_S)
    acting.end()
    watching.join(PATIENCE_S)
    assert not watching.is_alive()


def test_a_thread_waits_for_who_acts_but_not_for_ever() -> None:
    now_s, waited = [100.0], threading.Event()
    acting = Acting(lambda: now_s[0])

    def wait() -> None:
        acting.wait_until_nobody()
        waited.set()

    acting.begin()
    now_s[0] = 0.0  # his moment is not over for 100 s
    waiting = threading.Thread(target=wait)
    waiting.start()
    wait_until(lambda: acting.waiting == 1)
    assert not waited.is_set()
    acting.end()
    waiting.join(PATIENCE_S)
    assert waited.is_set()
    acting.begin()
    acting.wait_until_nobody()  # returns after a moment
    assert acting.count == 1


def test_who_acts_for_long_is_waited_for_once() -> None:
    """A plan takes seconds: viewers would see three pictures in each of them."""
    now_s = [100.0]
    acting = Acting(lambda: now_s[0])
    acting.begin()
    now_s[0] += 0.31
    began_s = time.monotonic()
    for _ in range(20):
        asyncio.run(acting.nobody())
    assert time.monotonic() - began_s < 20 * 0.3


def test_a_command_acts_until_the_robot_has_answered(room: Room) -> None:
    case_id = room.open_case()
    number = room.approved_plan(case_id)
    room.robot.answers_moves = room.robot.hang
    assert room.post(f"/cases/{case_id}/motions", {"plan": number}).status_code == 202
    assert room.robot.moved.wait(PATIENCE_S)
    wait_until(lambda: room.gateway.acting.count <= 1)  # the request ends a moment after its answer
    assert room.gateway.acting.count == 1, "the request has ended, the command has not"
    room.robot.release.set()
    wait_until(lambda: room.gateway.acting.count == 0)


def test_requests_are_answered_while_what_streams_is_busy(room: Room) -> None:
    busy, released = threading.Event(), threading.Event()
    after = room.gateway.tail.after

    def slow(sequence: int) -> News | None:
        busy.set()
        released.wait(PATIENCE_S)
        return after(sequence)

    room.gateway.tail.after = slow  # type: ignore[method-assign]
    with room.client.stream("GET", "/api/v1/events?after=0"):
        assert busy.wait(PATIENCE_S)
        answer = httpx.get(f"{room.client.base_url}/api/v1/cases", headers=room.client.headers, timeout=PATIENCE_S / 2)
        assert answer.status_code == 200
        released.set()
