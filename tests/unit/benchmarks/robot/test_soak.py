"""The soak: what holds in an hour, and in the minutes that CI plays."""

import pytest

from benchmarks.robot.process_figures import ProcessFigures, Sample
from benchmarks.robot.soak import Soak, holds


def soak(grown: float = 0.0, stop_s: float = 0.01, missing: int = 0) -> Soak:
    """A run in which one process grows steadily."""
    memory_mib = [100.0 * (1.0 + grown * at / 100.0) for at in range(101)]
    samples = [
        Sample(float(at), {"ui_api": ProcessFigures(memory_mib=mib, handles=10, threads=4, cpu_s=0.0)}, {})
        for at, mib in enumerate(memory_mib)
    ]
    return Soak(samples, (0.01,) * 10, (stop_s,) * 10, {}, missing)


@pytest.mark.parametrize(
    ("result", "in_an_hour", "in_five_minutes"),
    [
        (soak(), True, True),
        (soak(grown=0.04), False, True),
        (soak(grown=0.2), False, False),
        (soak(stop_s=0.06), False, True),
        (soak(missing=1), False, False),
    ],
)
def test_minutes_judge_growth_and_the_record_and_an_hour_judges_stops_too(
    result: Soak, in_an_hour: object, in_five_minutes: object
) -> None:
    assert holds(result, 60) is in_an_hour
    assert holds(result, 5) is in_five_minutes
