"""Those who follow the same thing on one event loop: one task serves all, and makes what they get once.

A task for each of fifty viewers, each with a message of its own, kept the application busier than everything else. Here
a viewer costs one look and one write for each picture. Nobody waits for somebody slow: who has not read what he got
last gets nothing more until he has, and whoever reads nothing at all is cut off.
"""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from typing import Final, Generic, Protocol, TypeVar

from services.ui_api.handlers.acting import Acting
from services.ui_api.outlet import Outlet
from services.ui_api.routes.awakening import Awakening
from shared.threads import report_error

# Who is stuck, and whom to remind that the connection is there, is looked for that often where nothing happens.
LOOK_EVERY_S: Final = 5.0
# Followers that are served without a break. Chosen: a tenth of fifty.
_IN_ONE_GO: Final = 5


class Follower(Protocol):
    """Somebody who follows."""

    @property
    def outlet(self) -> Outlet:
        """Where he reads."""


F = TypeVar("F", bound=Follower)


@dataclass(frozen=True, slots=True)
class Programme(Generic[F]):
    """What an audience follows.

    Attributes
    ----------
    name
        For the log.
    listening
        Has its argument called whenever there is something new, for as long as the context lasts.
    begin_round
        What is new now, for a function that writes it to one follower unless he has it. Neither of them waits.
    """

    name: str
    listening: Callable[[Callable[[], None]], AbstractContextManager[None]]
    begin_round: Callable[[], Callable[[F], None]]


class Audience(Generic[F]):
    """All followers of one event loop; belongs to it."""

    def __init__(self, programme: Programme[F], acting: Acting) -> None:
        self._programme, self._acting = programme, acting
        self._news = Awakening()
        self._followers: dict[F, None] = {}
        self._serving: asyncio.Task[None] | None = None

    @contextmanager
    def joined(self, follower: F) -> Iterator[None]:
        """Be served for as long as the context lasts."""
        self._followers[follower] = None
        if self._serving is None:
            self._serving = asyncio.get_running_loop().create_task(self._serve())
        self.look()
        try:
            yield
        finally:
            del self._followers[follower]
            if not self._followers and self._serving is not None:
                self._serving.cancel()
                self._serving = None

    def look(self) -> None:
        """Serve once more: from any thread, never waits."""
        self._news.call()

    async def _serve(self) -> None:
        now_s = asyncio.get_running_loop().time
        try:
            with self._programme.listening(self.look):
                while True:
                    await self._acting.nobody()
                    self._news.clear()  # before anything is looked at: what comes after the look wakes the task
                    await self._serve_round(now_s)
                    with suppress(TimeoutError):
                        async with asyncio.timeout(LOOK_EVERY_S):  # `wait_for` may swallow that it was cancelled
                            await self._news.wait()
        except Exception as error:  # noqa: BLE001 - the border of a task: what streams must not end what acts
            report_error(self._programme.name, error)
            self._serving = None
            for follower in tuple(self._followers):
                follower.outlet.abort()

    async def _serve_round(self, now_s: Callable[[], float]) -> None:
        serve = self._programme.begin_round()
        for number, follower in enumerate(tuple(self._followers), start=1):
            if follower in self._followers:  # he may have left meanwhile
                follower.outlet.end_if_stuck(now_s())
                serve(follower)
            if number % _IN_ONE_GO == 0:
                await asyncio.sleep(0.0)  # under TLS requests come on this loop too
                await self._acting.nobody()
