"""A request to end is heard whichever thread the system gives it to."""

import subprocess
import sys
import threading

import pytest

from shared.signals import set_by_signals

PATIENCE_S = 60.0
PROGRAM = """
import signal, threading
from shared.signals import set_by_signals
stop, waiting = threading.Event(), threading.Event()
def other():
    waiting.wait()
    signal.pthread_kill(threading.get_ident(), signal.{name})
with set_by_signals(stop):
    threading.Thread(target=other, daemon=True).start()
    waiting.set()
    stop.wait()
print("ended")
"""


@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT"])
def test_a_signal_that_another_thread_gets_ends_the_wait(name: str) -> None:
    command = [sys.executable, "-c", PROGRAM.format(name=name)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
    assert ended.stdout == "ended\n"


def test_handlers_and_threads_are_as_before_afterwards() -> None:
    threads = threading.active_count()
    with set_by_signals(threading.Event()):
        assert threading.active_count() == threads + 1
    assert threading.active_count() == threads
