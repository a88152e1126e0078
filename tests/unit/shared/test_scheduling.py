"""Precedence on the processor, where the system allows it."""

import gc
import os
import resource
import subprocess
import sys
import threading
from collections.abc import Callable

import pytest

from shared.scheduling import has_precedence, keep_collections_short, ordinary, precedence, take_precedence

POLICY_OF_A_CHILD = [sys.executable, "-I", "-S", "-c", "import os; print(os.sched_getscheduler(0))"]


def in_a_thread(work: Callable[[], object]) -> object:
    """Scheduling belongs to a thread: the tests' own stays as it is."""
    results: list[object] = []
    thread = threading.Thread(target=lambda: results.append(work()))
    thread.start()
    thread.join()
    (result,) = results
    return result


def policy_of_a_child() -> int:
    return int(subprocess.run(POLICY_OF_A_CHILD, capture_output=True, check=True).stdout)


def needs_permission() -> None:
    if os.geteuid() != 0 and resource.getrlimit(resource.RLIMIT_RTPRIO)[0] < 1:
        pytest.skip("neither root nor a limit RTPRIO of 1")


def test_precedence_passes_on_to_threads_and_processes_but_not_to_what_is_started_as_ordinary() -> None:
    needs_permission()

    def work() -> tuple[bool, object, int, int]:
        took = take_precedence()
        thread = in_a_thread(has_precedence)
        child = policy_of_a_child()
        with ordinary():
            other = policy_of_a_child()
        return took and has_precedence(), thread, child, other

    assert in_a_thread(work) == (True, True, os.SCHED_RR, os.SCHED_OTHER)


def test_precedence_for_a_while_ends() -> None:
    needs_permission()

    def work() -> list[bool]:
        with precedence():
            within = has_precedence()
        return [within, has_precedence()]

    assert in_a_thread(work) == [True, False]


def test_without_permission_nothing_changes_and_nothing_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    assert in_a_thread(take_precedence) is False


def test_what_was_imported_is_not_looked_at_again() -> None:
    try:
        keep_collections_short()
        assert gc.get_freeze_count() > 10_000
    finally:
        gc.unfreeze()
