"""While somebody acts, pictures wait, but not for ever."""

import asyncio

from starlette.types import Message, Receive, Scope, Send

from services.ui_api.routes.acting_first import Acting, ActingFirst


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
