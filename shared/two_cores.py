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

T = TypeVar("T")
R = TypeVar("R")


class _SecondCore:
    """A thread that has one piece of work at a time, or none."""

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="second-core")
        self._at_work = threading.Lock()

    def takes(self, work: Callable[[], R]) -> Future[R] | None:
        """The work under way, or None when the thread has some already or cannot be had."""
        if not self._at_work.acquire(blocking=False):
            return None
        try:
            return self._executor.submit(self._done, work)
        except RuntimeError:
            # No thread can be started, or the process ends. What lies in the queue must not be begun later, when its
            # caller has done it himself: it is thrown away, and nothing is taken any more (the lock stays closed).
            self._executor.shutdown(wait=False, cancel_futures=True)
            return None

    def _done(self, work: Callable[[], R]) -> R:
        try:
            return work()
        finally:
            self._at_work.release()


@cache
def _second_core() -> _SecondCore:
    return _SecondCore()


# a forked process inherits the executor but not its thread
os.register_at_fork(after_in_child=_second_core.cache_clear)


def on_both_halves(work: Callable[[slice], R], count: int, least: int) -> list[R]:
    """Results of the work on both halves of so many items; of fewer than `least`, on all of them at once.

    The work must spend its time where the interpreter is not held: in compiled loops, in OpenCV, in large arrays.
    """
    if count < least:
        return [work(slice(0, count))]
    first, second = slice(0, count // 2), slice(count // 2, count)
    under_way = _second_core().takes(lambda: work(second))
    if under_way is None:
        return [work(first), work(second)]
    try:
        done = work(first)
    except BaseException:
        # a caller that has his error may be sure that nothing writes to his places any more
        under_way.exception()
        raise
    return [done, under_way.result()]


def mapped(function: Callable[[T], R], items: Iterable[T], least: int) -> list[R]:
    """The function's values, in order."""
    given: Sequence[T] = list(items)
    halves = on_both_halves(lambda part: [function(item) for item in given[part]], len(given), least)
    return [value for half in halves for value in half]
