"""The passes try every fault at every step, once."""

from collections import Counter

from benchmarks.faults.passes import passes, without
from benchmarks.faults.patient import STEPS
from benchmarks.faults.table import FAULTS


def test_every_fault_is_tried_at_every_step_once() -> None:
    tried = Counter(planned.key for each in passes(FAULTS, seed=7) for planned in each)
    assert len(tried) == len(FAULTS) * len(STEPS)
    assert set(tried.values()) == {1}


def test_there_are_at_least_200_combinations() -> None:
    assert len(FAULTS) * len(STEPS) >= 200


def test_a_pass_follows_the_procedure() -> None:
    for each in passes(FAULTS, seed=7):
        assert tuple(planned.step for planned in each) == STEPS


def test_another_seed_gives_another_order() -> None:
    assert passes(FAULTS, seed=7) == passes(FAULTS, seed=7)
    assert passes(FAULTS, seed=7)[0] != passes(FAULTS, seed=8)[0]


def test_what_was_tried_is_left_out() -> None:
    planned = passes(FAULTS, seed=7)
    done = {one.key for each in planned[:3] for one in each} | {planned[3][0].key}
    left = without(planned, done)
    assert len(left) == len(planned) - 3
    assert left[0] == planned[3][1:]


def test_names_of_faults_differ() -> None:
    assert len({fault.name for fault in FAULTS}) == len(FAULTS)
