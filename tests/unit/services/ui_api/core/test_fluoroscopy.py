"""Which frames of a run remain when it has ended, and which can be claimed."""

from services.ui_api.core.fluoroscopy import CLAIMED_WITHIN_S, MOST_HELD, FluoroscopyRun


def run_of(frames: int, newest: int = 3) -> FluoroscopyRun[int]:
    """A run that holds numbered frames."""
    run: FluoroscopyRun[int] = FluoroscopyRun(newest)
    for number in range(frames):
        run.hold(str(number), number)
    return run


def test_of_a_run_the_newest_remain() -> None:
    run = run_of(20)
    assert run.end(now_s=0.0) == [17, 18, 19]
    assert run.end(now_s=0.0) == []


def test_a_frame_that_is_claimed_is_held_no_longer() -> None:
    run = run_of(20)
    assert run.claim("5") == 5
    assert run.claim("5") is None
    assert run.claim("18") == 18
    assert run.end(now_s=0.0) == [16, 17, 19]


def test_the_same_frame_again_is_held_once() -> None:
    run = run_of(3)
    run.hold("2", 2)
    assert run.end(now_s=0.0) == [0, 1, 2]


def test_a_long_run_takes_no_more_memory_than_a_short_one() -> None:
    run = run_of(3 * MOST_HELD)
    held = [k for k in range(3 * MOST_HELD) if run.claim(str(k)) is not None]
    assert held == list(range(2 * MOST_HELD, 3 * MOST_HELD))


def test_none_remain_when_none_are_wanted() -> None:
    assert run_of(3, newest=0).end(now_s=0.0) == []


def test_a_frame_can_be_claimed_after_its_run_has_ended() -> None:
    run = run_of(20)
    assert run.end(now_s=0.0) == [17, 18, 19]
    assert run.claim("18") is None
    assert run.claim("5") == 5
    assert run.claim("5") is None
    assert run.end(now_s=0.0) == []


def test_a_day_of_runs_leaves_nothing_behind() -> None:
    run = run_of(20)
    run.end(now_s=0.0)
    run.hold("later", 20)
    run.end(now_s=CLAIMED_WITHIN_S)
    assert run.claim("5") == 5
    run.end(now_s=CLAIMED_WITHIN_S + 1.0)
    assert [k for k in range(20) if run.claim(str(k)) is not None] == []


def test_many_runs_take_no_more_memory_than_one() -> None:
    run = run_of(0)
    for first in range(0, 3 * MOST_HELD, 32):
        for number in range(first, first + 32):
            run.hold(str(number), number)
        run.end(now_s=0.0)
    left = [k for k in range(3 * MOST_HELD) if run.claim(str(k)) is not None]
    assert len(left) == MOST_HELD
    assert left[-1] == 3 * MOST_HELD - 4


def test_a_frame_that_is_claimed_before_it_arrives_is_awaited_once() -> None:
    run = run_of(2)
    assert run.claim("2") is None
    assert run.was_awaited("2")
    assert not run.was_awaited("2")
