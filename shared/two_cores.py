"""Share a computation's inner loops between two cores.

Only for leaves: loops over pixels, pictures or balls that write to places of their own and wait for nothing. The result
is the same as on one core, bit by bit, but for sums over halves.
"""

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


@cache
def _second_core() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=1, thread_name_prefix="second-core")


# a forked process inherits the executor but not its thread
os.register_at_fork(after_in_child=_second_core.cache_clear)


def on_both_halves(work: Callable[[slice], R], count: int, least: int) -> list[R]:
    """Results of the work on both halves of so many items; of fewer than `least`, on all of them at once.

    The work must spend its time where the interpreter is not held: in compiled loops, in OpenCV, in large arrays.
    """
    if count < least:
        return [work(slice(0, count))]
    middle = count // 2
    try:
        second = _second_core().submit(work, slice(middle, count))
    except RuntimeError:  # the process ends, and starts nothing new; what it is at may still be finished
        return [work(slice(0, middle)), work(slice(middle, count))]
    return [work(slice(0, middle)), second.result()]


def mapped(function: Callable[[T], R], items: Iterable[T], least: int) -> list[R]:
    """The function's values, in order."""
    given: Sequence[T] = list(items)
    halves = on_both_halves(lambda part: [function(item) for item in given[part]], len(given), least)
    return [value for half in halves for value in half]
