"""Answers stops: once the controller has shown standstill and brakes after it, or when the time for that is up.

A stop itself waits for nothing of this. Any number of stops share the worker's next readback.
"""

import queue
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeAlias

from services.robot.core.status import DriveStatus
from services.robot.core.stop_result import SentStop, StopResult, stop_result
from services.robot.core.tuning import SUPERVISION
from services.robot.drive.motion_controller import MotionController
from shared.robot_states import MotionState
from shared.threads import supervised_thread

StopAnswer: TypeAlias = Callable[[StopResult, MotionState], None]


@dataclass(frozen=True, slots=True)
class _Waiting:
    """A stop that is still to be answered, until a time of the monotonic clock."""

    sent: SentStop
    until_s: float
    answer: StopAnswer


class StopConfirmation:
    """Answers stops on a thread of its own.

    Parameters
    ----------
    motion
        What is known of the robot.
    clock_s
        Monotonic clock.
    """

    def __init__(self, motion: MotionController, clock_s: Callable[[], float]) -> None:
        self._motion = motion
        self._clock_s = clock_s
        self._asked: queue.SimpleQueue[_Waiting | None] = queue.SimpleQueue()
        self._ended = threading.Event()
        self._thread = supervised_thread("stop-confirmation", self._answer_forever)

    def start(self) -> None:
        """Begin to answer."""
        self._thread.start()

    def close(self) -> None:
        """Answer what waits with what is known, and end."""
        self._ended.set()
        self._asked.put(None)
        self._thread.join()

    def ask(self, sent: SentStop, answer: StopAnswer) -> None:
        """Answer later, from another thread."""
        self._asked.put(_Waiting(sent, self._clock_s() + SUPERVISION.stop_confirmed_within_s, answer))

    def _answer_forever(self) -> None:
        waiting: list[_Waiting] = []
        while not self._ended.is_set():
            if not waiting and (asked := self._asked.get()) is not None:
                waiting.append(asked)
            status = self._motion.status
            waiting = self._answer(waiting + self._newly_asked(), status)
            if waiting:
                self._motion.wait_for_change(status, min(one.until_s for one in waiting) - self._clock_s())
        self._answer(waiting + self._newly_asked(), self._motion.status)

    def _newly_asked(self) -> list[_Waiting]:
        asked: list[_Waiting] = []
        with suppress(queue.Empty):
            while True:
                one = self._asked.get_nowait()
                asked += [] if one is None else [one]
        return asked

    def _answer(self, waiting: list[_Waiting], status: DriveStatus) -> list[_Waiting]:
        """Answer those of which nothing more will become known; the others."""
        now_s = self._clock_s()
        left: list[_Waiting] = []
        for one in waiting:
            result = stop_result(one.sent, status.readback, status.detail)
            if result.confirmed or not result.written or now_s >= one.until_s or self._ended.is_set():
                one.answer(result, status.state)
            else:
                left.append(one)
        return left
