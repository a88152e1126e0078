"""A request to end is heard whichever thread the system gives it to, and so is what started this process."""

import os
import subprocess
import sys
import threading
import time

import pytest

from shared.signals import PARENT_PIPE, parent_silent_for_s, set_by_signals

PATIENCE_S = 60.0
PROGRAM = """
import signal, threading
from shared.signals import PARENT_PIPE, parent_silent_for_s, set_by_signals
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


def test_signs_of_life_of_the_parent_are_heard_and_the_end_of_its_pipe_is_the_end() -> None:
    reads, writes = os.pipe()
    os.environ[PARENT_PIPE] = str(reads)  # taken out again on entering
    stop = threading.Event()
    with set_by_signals(stop):
        begun_s = time.monotonic()
        os.write(writes, b".")
        while parent_silent_for_s() > time.monotonic() - begun_s:
            assert time.monotonic() - begun_s < PATIENCE_S
            time.sleep(0.01)
        assert not stop.is_set()
        time.sleep(0.05)
        assert parent_silent_for_s() >= 0.05
        os.close(writes)
        assert stop.wait(PATIENCE_S)
    os.close(reads)
