"""The profile of a move: numbers worked out by hand, and what holds for all profiles."""

from itertools import pairwise

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from simulation.controller.motion_profile import rest_to_rest, to_rest


def test_long_move_ramps_cruises_and_ramps() -> None:
    # 0.5 of the way per second, reached in 0.1 s: 0.025 + 0.025 of the way on the ramps, 0.95 at cruise takes 1.9 s.
    profile = rest_to_rest(0.5, 0.1)
    assert profile.duration_s == pytest.approx(2.1)
    assert profile.at(0.1).share == pytest.approx(0.025)
    assert profile.at(0.1).speed_per_s == pytest.approx(0.5)
    assert profile.at(1.05).share == pytest.approx(0.5)
    assert profile.at(2.0).share == pytest.approx(0.975)
    assert profile.at(99.0).share == pytest.approx(1.0)
    assert profile.at(99.0).speed_per_s == 0.0


def test_short_move_never_reaches_cruising_speed() -> None:
    # 100 per s² for half the way each: peak speed 10 per s after 0.1 s.
    profile = rest_to_rest(1000.0, 10.0)
    assert profile.duration_s == pytest.approx(0.2)
    assert profile.at(0.1).speed_per_s == pytest.approx(10.0)
    assert profile.at(0.1).share == pytest.approx(0.5)


def test_coming_to_rest_takes_speed_squared_over_twice_the_deceleration() -> None:
    profile = to_rest(0.5, 5.0)
    assert profile.duration_s == pytest.approx(0.1)
    assert profile.at(1.0).share == pytest.approx(0.025)


@given(st.floats(1e-3, 1e3), st.floats(1e-3, 10.0), st.lists(st.floats(0.0, 1.0), min_size=2, max_size=8))
@example(987.0, 1.609375, [1.0, 0.9999999999999999])
def test_moves_never_go_back_and_end_where_they_should(cruise: float, ramp_s: float, moments: list[float]) -> None:
    profile = rest_to_rest(cruise, ramp_s)
    shares = [profile.at(m * profile.duration_s).share for m in sorted(moments)]
    assert all(later >= earlier - 1e-9 for earlier, later in pairwise(shares))
    assert shares[0] >= -1e-9
    assert shares[-1] <= 1.0 + 1e-9
    assert profile.at(profile.duration_s).share == pytest.approx(1.0)
    assert all(profile.at(m * profile.duration_s).speed_per_s <= cruise * (1.0 + 1e-9) for m in moments)
