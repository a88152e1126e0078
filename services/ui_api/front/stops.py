"""Stops that come over REST: sent at once, and handed to the application to be recorded."""

import itertools
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Final

from services.ui_api.handlers.stop import StopOutcome
from services.ui_api.handlers.stop_sender import StopSender
from services.ui_api.link_messages import FromFront, StopBegun, StopEnded

BY_REST: Final = "stop requested over REST"
_WHO: Final = "rest"


@dataclass(frozen=True, slots=True)
class Stop:
    """A stop under way: what came of it, and whether it is on record."""

    number: int
    outcome: "Future[StopOutcome]"
    recorded: "Future[None]"


class FrontStops:
    """Sends stops and keeps what came of them until the application has recorded it.

    Parameters
    ----------
    tell
        Hands a message to the application, from any thread, and never waits; nothing is lost when it is not there.
    """

    def __init__(self, sender: StopSender, tell: Callable[[FromFront], None]) -> None:
        self._sender, self._tell = sender, tell
        self._numbers = itertools.count(1)
        self._unrecorded: dict[int, Stop] = {}

    def begin(self) -> Stop:
        """Send a stop now."""
        began_s = time.monotonic()
        stop = Stop(next(self._numbers), self._sender.begin(BY_REST), Future())
        stop.recorded.set_running_or_notify_cancel()  # from now on nobody who waits can give it up
        self._unrecorded[stop.number] = stop
        self._tell(StopBegun())
        stop.outcome.add_done_callback(lambda done: self._hand_over(stop, done, time.monotonic() - began_s))
        return stop

    def note_recorded(self, number: int) -> None:
        """The application has recorded a stop."""
        stop = self._unrecorded.pop(number, None)
        if stop is not None:
            stop.recorded.set_result(None)

    def __len__(self) -> int:
        """How many are not on record yet."""
        return len(self._unrecorded)

    def _hand_over(self, stop: Stop, done: "Future[StopOutcome]", took_s: float) -> None:
        if done.exception() is not None:
            return  # the thread's supervisor has made it a fault
        outcome = done.result()
        self._tell(
            StopEnded(
                number=stop.number,
                reason=BY_REST,
                who=_WHO,
                confirmed=outcome.confirmed,
                state=None if outcome.state is None else outcome.state.value,
                message=outcome.message,
                took_s=took_s,
            )
        )
