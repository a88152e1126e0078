"""Stops of many callers at once: each goes out at once, on a thread of its own that waits for the robot's answer.

There is no pool and no queue, so that no stop waits for another one's answer.
"""

import threading
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Final

from services.ui_api.handlers.stop import StopOutcome
from shared.threads import supervised_thread

# Of stops that the robot has not answered yet. A further one shares the answer of the newest of them: the robot has
# that many stops before it, and moves nothing after the first until a person has acknowledged it.
MOST_AT_ONCE: Final = 256


class StopSender:
    """Sends stops.

    Parameters
    ----------
    stop
        Sends one stop for a reason and waits for the robot's answer.
    """

    def __init__(self, stop: Callable[[str], StopOutcome]) -> None:
        self._stop = stop
        self._lock = threading.Lock()
        self._under_way: list[Future[StopOutcome]] = []

    def begin(self, reason: str) -> "Future[StopOutcome]":
        """Send a stop now; the future has what came of it."""
        answer: Future[StopOutcome] = Future()
        answer.set_running_or_notify_cancel()  # from now on nobody who waits can give it up
        with self._lock:
            if len(self._under_way) >= MOST_AT_ONCE:
                return self._under_way[-1]
            self._under_way.append(answer)
        supervised_thread("stop", partial(self._send, reason, answer)).start()
        return answer

    def __len__(self) -> int:
        return len(self._under_way)

    def _send(self, reason: str, answer: "Future[StopOutcome]") -> None:
        try:
            answer.set_result(self._stop(reason))
        except BaseException as error:
            answer.set_exception(error)
            raise
        finally:
            with self._lock:
                self._under_way.remove(answer)
