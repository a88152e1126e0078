"""Share a computation's inner loops between two cores.

For loops over pixels, pictures or balls that write to places of their own. The result is the same as on one core, bit
by bit, but for sums over halves. What finds the second core at work, be it for another thread or because it runs there
itself, stays on its own.
"""

import os
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from typing import TypeVar

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")


class _SecondCore:
    """A thread that has one piece of work at a time, or none."""

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="second-core")
        self._at_work = threading.Lock()

    def takes(self, work: Callable[[], R]) -> Future[R] | None:
        """The work under way, or None when the thread has some already or starts nothing new."""
        if not self._at_work.acquire(blocking=False):
            return None
        try:
            return self._executor.submit(self._done, work)
        except RuntimeError:  # the process ends; what it is at may still be finished
            self._at_work.release()
            return None

    def _done(self, work: Callable[[], R]) -> R:
        try:
            return work()
        finally:
            self._at_work.release()

    def shut_down(self) -> None:
        """Start nothing new."""
        self._executor.shutdown()


@cache
def _second_core() -> _SecondCore:
    return _SecondCore()


# a forked process inherits the executor but not its thread
os.register_at_fork(after_in_child=_second_core.cache_clear)


def side_by_side(first: Callable[[], S], second: Callable[[], R]) -> tuple[S, R]:
    """Results of two pieces of work that need nothing of one another."""
    under_way = _second_core().takes(second)
    if under_way is None:
        return first(), second()
    try:
        done = first()
    except BaseException:
        # what was handed on writes to nobody's places any more once the caller has its error
        under_way.exception()
        raise
    return done, under_way.result()


def on_both_halves(work: Callable[[slice], R], count: int, least: int) -> list[R]:
    """Results of the work on both halves of so many items; of fewer than `least`, on all of them at once.

    The work must spend its time where the interpreter is not held: in compiled loops, in OpenCV, in large arrays.
    """
    if count < least:
        return [work(slice(0, count))]
    middle = count // 2
    return list(side_by_side(lambda: work(slice(0, middle)), lambda: work(slice(middle, count))))


def mapped(function: Callable[[T], R], items: Iterable[T], least: int) -> list[R]:
    """The function's values, in order."""
    given: Sequence[T] = list(items)
    halves = on_both_halves(lambda part: [function(item) for item in given[part]], len(given), least)
    return [value for half in halves for value in half]
