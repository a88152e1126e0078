"""How a process hears that it should end: SIGTERM and SIGINT set an event that its main thread waits for."""

import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from shared.threads import supervised_thread

_NUMBERS = (signal.SIGTERM, signal.SIGINT)


@contextmanager
def set_by_signals(stop: threading.Event) -> Iterator[None]:
    """SIGTERM and SIGINT set the event; the handlers before are put back on leaving. Call from the main thread.

    The system gives a signal to any thread of the process, Zenoh's own too, and Python runs its handlers in the main
    thread, which sleeps in `stop.wait()` and is not woken for it. The number that Python writes to the wakeup socket
    at once wakes a thread that does nothing else.
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
        yield
    finally:
        for number, handler in zip(_NUMBERS, before, strict=True):
            signal.signal(number, handler)
        signal.set_wakeup_fd(wakeup_before)
        written.close()
        thread.join()
        received.close()
