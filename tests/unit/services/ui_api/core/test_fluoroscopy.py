"""Which frames of a run are left when it has ended, and that single shots are never held."""

import pytest

from services.ui_api.core.fluoroscopy import MOST_HELD, FluoroscopyRun, RunLimits

LIMITS = RunLimits(interval_s=0.5, newest=3)


def run_of(times_s: list[float], limits: RunLimits = LIMITS) -> tuple[FluoroscopyRun[int], list[int]]:
    """A run, and which of its frames it did not hold; frames are numbered."""
    run: FluoroscopyRun[int] = FluoroscopyRun(limits)
    own = [number for number, at_s in enumerate(times_s) if not run.holds(str(number), int(1e9 * at_s), number)]
    return run, own


@pytest.mark.parametrize("times_s", [[1.0, 2.0, 3.0], [1.0, 1.5, 2.0], [3.0, 1.0, 0.5], [1.0]])
def test_single_shots_are_never_held(times_s: list[float]) -> None:
    run, own = run_of(times_s)
    assert own == list(range(len(times_s)))
    assert run.end() == []


def test_of_a_run_the_newest_are_left() -> None:
    run, own = run_of([1.0 + 0.1 * k for k in range(20)])
    assert own == [0]
    assert run.end() == [17, 18, 19]
    assert run.end() == []


def test_a_frame_that_is_claimed_is_held_no_longer() -> None:
    run, _ = run_of([1.0 + 0.1 * k for k in range(20)])
    assert run.claim("5") == 5
    assert run.claim("5") is None
    assert run.claim("18") == 18
    assert run.end() == [16, 17, 19]


def test_the_same_frame_again_stays_held() -> None:
    run, _ = run_of([1.0, 1.1, 1.2])
    assert run.holds("2", int(1.2e9), 2)
    assert run.end() == [1, 2]


def test_a_long_run_takes_no_more_memory_than_a_short_one() -> None:
    run, _ = run_of([1.0 + 0.1 * k for k in range(3 * MOST_HELD)])
    held = [k for k in range(3 * MOST_HELD) if run.claim(str(k)) is not None]
    assert held == list(range(2 * MOST_HELD, 3 * MOST_HELD))


def test_nothing_is_left_when_nothing_is_wanted() -> None:
    run, _ = run_of([1.0, 1.1, 1.2], RunLimits(0.5, 0))
    assert run.end() == []


def test_a_frame_can_be_claimed_after_its_run_has_ended() -> None:
    run, _ = run_of([1.0 + 0.1 * k for k in range(20)])
    assert run.end() == [17, 18, 19]
    assert run.claim("18") is None
    assert run.claim("5") == 5
    assert run.claim("5") is None
    assert run.end() == []


def test_many_runs_take_no_more_memory_than_one() -> None:
    run, _ = run_of([])
    for first in range(0, 3 * MOST_HELD, 32):
        for number in range(first, first + 32):
            run.holds(str(number), int(1e9 * (1.0 + 0.1 * number)), number)
        run.end()
    left = [k for k in range(3 * MOST_HELD) if run.claim(str(k)) is not None]
    assert len(left) == MOST_HELD
    assert left[-1] == 3 * MOST_HELD - 4


def test_a_frame_that_is_claimed_before_it_comes_is_told_once() -> None:
    run, _ = run_of([1.0, 1.1])
    assert run.claim("2") is None
    assert run.holds("2", int(1.2e9), 2)
    assert run.was_awaited("2")
    assert not run.was_awaited("2")
    assert run.claim("2") == 2
