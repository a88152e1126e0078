"""Pipes by which processes learn that the one that started them has ended, or hangs."""

import os
import select

from distalock.lifelines import Lifelines

PATIENCE_S = 60.0


def test_signs_of_life_come_until_it_ends_and_then_the_end_of_the_file() -> None:
    with Lifelines() as lifelines:
        with lifelines.handed_over("robot") as handed:
            inherited = os.dup(handed)
        for _ in range(3):
            assert os.read(inherited, 1) == b"."
    while os.read(inherited, 4096):
        pass
    os.close(inherited)


def test_a_process_that_reads_nothing_keeps_no_other_waiting() -> None:
    with Lifelines() as lifelines:
        with lifelines.handed_over("hung") as handed:
            hung = os.dup(handed)
        os.set_blocking(lifelines._ends["hung"], True)
        while select.select([], [lifelines._ends["hung"]], [], 0.0)[1]:
            os.write(lifelines._ends["hung"], bytes(4096))
        os.set_blocking(lifelines._ends["hung"], False)
        with lifelines.handed_over("robot") as handed:
            inherited = os.dup(handed)
        assert os.read(inherited, 1) == b"."
    os.close(hung)
    os.close(inherited)


def test_a_process_that_is_started_again_gets_a_pipe_of_its_own() -> None:
    with Lifelines() as lifelines:
        with lifelines.handed_over("robot") as handed:
            first = os.dup(handed)
        with lifelines.handed_over("robot") as handed:
            second = os.dup(handed)
        while os.read(first, 4096):
            pass
        assert os.read(second, 1) == b"."
    os.close(first)
    os.close(second)
