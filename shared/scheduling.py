"""Precedence on the processor for processes on the way of a stop: front, router, robot service and guardian.

Under Linux's ordinary scheduling a process that wakes may wait some milliseconds, at each step of the way, for others
that compute. Real-time scheduling runs it at once. It needs a limit RTPRIO of 1 or more, or root; without, a stop goes
its way among the others.

Nor may Python itself hold a stop up. A collection of the oldest generation goes through all objects that there are,
with every thread waiting: 57 ms were seen in a front that was taking in two thousand connections, most of them for what
had been imported.
"""

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

# Chosen: the lowest, which goes before everything that is ordinary; the system's own threads go before it.
_PRIORITY: Final = 1


def take_precedence() -> bool:
    """Take it for this thread and the threads and processes that it starts; whether the system allows it."""
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_PRIORITY))
    return has_precedence()


def keep_collections_short() -> None:
    """Let the collector pass over what was imported, for good.

    For processes on the way of a stop, once all is imported. What comes later is collected as before: a front without
    full collections grew by 3 MiB a minute, because each connection of asyncio's leaves a cycle.
    """
    gc.collect()
    gc.freeze()


def has_precedence() -> bool:
    """Whether this thread goes before all that are ordinary."""
    return os.sched_getscheduler(0) in (os.SCHED_RR, os.SCHED_FIFO)


@contextmanager
def precedence() -> Iterator[None]:
    """The same for as long as the context lasts."""
    with _restored():
        take_precedence()
        yield


@contextmanager
def ordinary() -> Iterator[None]:
    """For as long as the context lasts this thread is ordinary, and so is for ever what it starts within."""
    with _restored():
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        yield


@contextmanager
def _restored() -> Iterator[None]:
    policy, priority = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        yield
    finally:
        with suppress(OSError):
            os.sched_setscheduler(0, policy, priority)
