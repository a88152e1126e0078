"""A day's soak: what counts as growth, and what does not hold."""

import numpy as np
import pytest

from benchmarks.robot.process_figures import ProcessFigures, Sample
from benchmarks.robot.soak_day import HOURS_EACH, Played, failures, growth_an_hour, stop_p99_ms

COUNT = 48


def played(growth_an_hour_share: float = 0.0, stop_s: float = 0.01, ending: str = "drilled") -> list[Played]:
    """A day in which one process grows steadily after the first quarter, whose memory is nothing to go by."""
    day = []
    for number in range(COUNT):
        hours = HOURS_EACH * number
        memory = 100.0 * (1.0 + growth_an_hour_share * hours) if number > COUNT // 4 else 50.0
        figures = ProcessFigures(memory_mib=memory, handles=10, threads=4, cpu_s=float(number))
        late = stop_s if number >= COUNT // 2 else 0.01
        sample = Sample(30.0 * (number + 1), {"imaging": figures}, {"inbox": 0.0})
        day.append(Played(ending if number == 3 else "drilled", (late,) * 10, sample, {"record": 1.0}))
    return day


def test_the_growth_is_that_of_an_hour_of_the_day() -> None:
    samples = [one.sample for one in played(growth_an_hour_share=0.02)]
    # of the memory in the middle of the first third after the warm-up, by then 106 % of that at the beginning
    assert growth_an_hour(samples, "imaging") == pytest.approx(0.02 / 1.06, rel=0.05)


def test_a_day_without_growth_holds() -> None:
    assert failures(played()) == []


@pytest.mark.parametrize(
    ("day", "named"),
    [
        (played(growth_an_hour_share=0.02), "imaging grew by"),
        (played(stop_s=0.02), "99 % of stops within 20.0 ms"),
        (played(ending="refused: the robot is in fault"), "procedure 4: refused: the robot is in fault"),
    ],
)
def test_what_does_not_hold_is_named(day: list[Played], named: str) -> None:
    wrong = failures(day)
    assert len(wrong) == 1
    assert named in wrong[0]


def test_stops_of_the_first_third_are_set_against_those_of_the_last() -> None:
    first, last = stop_p99_ms(played(stop_s=0.03))
    np.testing.assert_allclose((first, last), (10.0, 30.0))
