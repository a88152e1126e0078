"""One task serves all who follow, and lets requests in between."""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from services.ui_api.handlers.acting import Acting
from services.ui_api.outlet import Outlet
from services.ui_api.routes.audience import Audience, Programme


class Transport(asyncio.Transport):
    def get_write_buffer_size(self) -> int:
        return 0


class Follower:
    def __init__(self, name: int) -> None:
        self.name, self.outlet = name, Outlet(Transport())


@contextmanager
def _silence(_: Callable[[], None]) -> Iterator[None]:
    yield


def served_beside(between: Callable[[list[object], Acting], None]) -> list[object]:
    """What one round does for twenty followers, with a callback that is due as soon as the first is served."""

    async def run() -> list[object]:
        order, acting, finished = list[object](), Acting(), asyncio.Event()

        def serve(follower: Follower) -> None:
            if not order:
                asyncio.get_running_loop().call_soon(between, order, acting)
            if not finished.is_set():  # the next round may begin before all have left
                order.append(follower.name)
            if follower.name == 19:
                finished.set()

        audience = Audience(Programme("test", _silence, lambda: serve), acting)
        with ExitStack() as stack:
            for name in range(20):
                stack.enter_context(audience.joined(Follower(name)))
            await asyncio.wait_for(finished.wait(), 60.0)
        return order

    return asyncio.run(run())


def test_a_request_is_taken_in_the_middle_of_a_round() -> None:
    order = served_beside(lambda order, _: order.append("request"))
    assert [one for one in order if one != "request"] == list(range(20))
    assert order.index("request") < 10


def test_who_begins_to_act_in_the_middle_of_a_round_goes_first() -> None:
    def act(order: list[object], acting: Acting) -> None:
        acting.begin()
        asyncio.get_running_loop().call_later(0.01, end, order, acting)

    def end(order: list[object], acting: Acting) -> None:
        order.append("acted")
        acting.end()

    order = served_beside(act)
    assert order.index("acted") < 10
    assert [one for one in order if one != "acted"] == list(range(20))
