"""How a process hears that it should end: SIGTERM and SIGINT, or the end of the process that started it.

Both set an event that its main thread waits for. What started it may also give signs of life on the same pipe, so that
it is missed when it hangs.
"""

import os
import select
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import structlog

from shared.threads import supervised_thread

# Number of an inherited pipe's reading end. Its other end closes with the process that started this one, however that
# ends; a service that nobody supervises must not go on moving a robot.
PARENT_PIPE: Final = "DISTALOCK_PARENT_PIPE"
_NUMBERS = (signal.SIGTERM, signal.SIGINT)
_LOOK_EVERY_MS: Final = 200
_MOST_SIGNS: Final = 4096

_log = structlog.get_logger("distalock.signals")


class _Parent:
    """What started this process: when it last gave a sign of life, on the monotonic clock."""

    heard_s = float("-inf")


def parent_silent_for_s() -> float:
    """Time since what started this process gave a sign of life; infinite when it gives none."""
    return time.monotonic() - _Parent.heard_s


@contextmanager
def set_by_signals(stop: threading.Event, linger_s: float = 0.0) -> Iterator[None]:
    """SIGTERM, SIGINT and the parent's end set the event; the handlers before are put back on leaving.

    Call from the main thread. The system gives a signal to any thread of the process, Zenoh's own too, and Python runs
    its handlers in the main thread, which sleeps in `stop.wait()` and is not woken for it. The number that Python
    writes to the wakeup socket at once wakes a thread that does nothing else.

    Parameters
    ----------
    linger_s
        How long to go on after the parent has ended: for what others need to end well.
    """
    received, written = socket.socketpair()
    written.settimeout(0.0)

    def relay() -> None:
        while number := received.recv(1):
            if number[0] in _NUMBERS:
                stop.set()

    thread = supervised_thread("signals", relay)
    thread.start()
    wakeup_before = signal.set_wakeup_fd(written.fileno(), warn_on_full_buffer=False)
    before = [signal.signal(number, lambda *_: None) for number in _NUMBERS]
    try:
        with _set_when_parent_ends(stop, linger_s):
            yield
    finally:
        for number, handler in zip(_NUMBERS, before, strict=True):
            signal.signal(number, handler)
        signal.set_wakeup_fd(wakeup_before)
        written.close()
        thread.join()
        received.close()


@contextmanager
def _set_when_parent_ends(stop: threading.Event, linger_s: float) -> Iterator[None]:
    # Taken out of the environment: the number means nothing to processes that this one starts.
    number = os.environ.pop(PARENT_PIPE, "")
    if not number.isdigit():
        yield
        return
    leaving = threading.Event()
    pipe = select.poll()
    pipe.register(int(number), select.POLLIN | select.POLLHUP)

    def watch() -> None:
        while not leaving.is_set():
            if not pipe.poll(_LOOK_EVERY_MS):
                continue
            if os.read(int(number), _MOST_SIGNS):
                _Parent.heard_s = time.monotonic()
            else:
                _log.warning("the process that started this one has ended; ending too", linger_s=linger_s)
                leaving.wait(linger_s)
                stop.set()
                return

    thread = supervised_thread("parent", watch)
    thread.start()
    try:
        yield
    finally:
        leaving.set()
        thread.join()
