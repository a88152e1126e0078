"""Random scenes with parts of their own: nothing wrong may be accepted, and good images must be."""

import pytest

from benchmarks.accuracy import statistics

SEEDS = range(7000, 7008)


@pytest.mark.slow
def test_random_scenes_are_localised_or_refused_but_never_wrong() -> None:
    found = statistics(SEEDS)
    print(f"seeds {SEEDS}: {found}")
    assert found.wrong == 0
    assert found.ended_wrong == 0
    assert found.accepted >= 7
    assert found.entry_mm[0] < 0.3
    assert found.axis_deg[0] < 0.5
    assert found.normalised_entry < 2.0
    assert found.normalised_axis < 2.0
