"""Sharing work between two cores gives what one gives, in order, also in a process forked from a busy one."""

import os
import threading
import time

import numpy as np
import pytest

from shared import two_cores
from shared.two_cores import mapped, on_both_halves


@pytest.mark.parametrize("count", [0, 1, 2, 7, 100])
def test_every_item_is_done_once(count: int) -> None:
    done = np.zeros(count, dtype=np.int64)

    def work(part: slice) -> None:
        done[part] += 1

    on_both_halves(work, count, 2)
    assert np.array_equal(done, np.ones(count))


def test_the_halves_run_at_the_same_time() -> None:
    both = threading.Barrier(2, timeout=60.0)
    assert on_both_halves(lambda _: both.wait() >= 0, 2, 2) == [True, True]


def test_few_items_stay_on_the_caller_s_core() -> None:
    assert on_both_halves(lambda _: threading.get_ident(), 3, 4) == [threading.get_ident()]


def test_values_come_in_order() -> None:
    assert mapped(lambda n: n * n, iter(range(9)), 2) == [n * n for n in range(9)]


@pytest.mark.parametrize("cause", ["the process ends", "no thread can be started"])
def test_without_a_second_core_both_halves_are_done_once_here(monkeypatch: pytest.MonkeyPatch, cause: str) -> None:
    second = two_cores._SecondCore()
    monkeypatch.setattr(two_cores, "_second_core", lambda: second)
    done = np.zeros(5, dtype=np.int64)

    def work(part: slice) -> int:
        done[part] += 1
        return threading.get_ident()

    def refused(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as while_it_lasts:
        if cause == "the process ends":
            second._executor.shutdown()
        else:
            while_it_lasts.setattr(threading.Thread, "start", refused)
        assert set(on_both_halves(work, 5, 2)) == {threading.get_ident()}
    # nothing of what was thrown away is begun later
    assert set(on_both_halves(work, 5, 2)) == {threading.get_ident()}
    assert np.array_equal(done, np.full(5, 2))


def test_work_within_work_stays_where_it_is() -> None:
    def inner(_: slice) -> set[int]:
        return set(on_both_halves(lambda _: threading.get_ident(), 2, 2))

    first, second = on_both_halves(inner, 2, 2)
    assert len(second) == 1
    assert threading.get_ident() in first


def test_who_finds_the_second_core_at_work_does_not_wait_for_it() -> None:
    at_work, finished = threading.Event(), threading.Event()

    def here_and_there(part: slice) -> bool:
        if part.start > 0:
            at_work.set()
            return finished.wait(60.0)
        assert at_work.wait(60.0)
        idents = on_both_halves(lambda _: threading.get_ident(), 2, 2)
        finished.set()
        return set(idents) == {threading.get_ident()}

    assert on_both_halves(here_and_there, 2, 2) == [True, True]
    both = threading.Barrier(2, timeout=60.0)
    assert on_both_halves(lambda _: both.wait() >= 0, 2, 2) == [True, True]  # it is free again


def test_an_error_here_waits_for_the_half_that_is_under_way() -> None:
    begun, ended = threading.Event(), threading.Event()

    def work(part: slice) -> None:
        if part.start == 0:
            assert begun.wait(60.0)
            raise ZeroDivisionError
        begun.set()
        time.sleep(0.1)
        ended.set()

    with pytest.raises(ZeroDivisionError):
        on_both_halves(work, 2, 2)
    assert ended.is_set()


@pytest.mark.parametrize("bad", [0, 8])
def test_an_error_in_either_half_is_the_caller_s(bad: int) -> None:
    with pytest.raises(ZeroDivisionError):
        mapped(lambda n: 1 // (n - bad), range(9), 2)


def test_a_forked_process_has_a_second_core_of_its_own() -> None:
    mapped(abs, range(4), 2)
    child = os.fork()
    if child == 0:
        os._exit(0 if mapped(abs, range(4), 2) == [0, 1, 2, 3] else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
