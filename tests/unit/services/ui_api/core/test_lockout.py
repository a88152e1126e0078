"""Passwords are tried ever more rarely, for one account from one address."""

import pytest

from services.ui_api.core.lockout import (
    FREE_FAILURES,
    MOST_PAIRS,
    Failures,
    after_failure,
    after_success,
    locked_for_s,
)

PAIR = ("nora", "10.0.0.7")


@pytest.mark.parametrize(
    ("count", "lock_s"),
    [(FREE_FAILURES - 1, 0.0), (FREE_FAILURES, 30.0), (FREE_FAILURES + 1, 60.0), (FREE_FAILURES + 40, 900.0)],
)
def test_each_failure_beyond_the_free_ones_doubles_the_time(count: int, lock_s: float) -> None:
    failures = Failures(count, 100.0)
    assert locked_for_s(failures, 100.0) == lock_s
    assert locked_for_s(failures, 100.0 + lock_s) == 0.0


def test_failures_count_by_account_and_address_and_are_forgotten() -> None:
    known = after_failure(after_failure({}, PAIR, 0.0), PAIR, 1.0)
    other = after_failure(known, ("nora", "10.0.0.8"), 2.0)
    assert (other[PAIR].count, other["nora", "10.0.0.8"].count) == (2, 1)
    assert PAIR not in after_success(other, PAIR)
    assert after_failure(known, PAIR, 3602.0)[PAIR].count == 1, "an hour later it is the first one"


def test_memory_is_bounded_and_the_oldest_makes_room() -> None:
    known = {(f"name-{number}", "10.0.0.7"): Failures(1, number / MOST_PAIRS) for number in range(MOST_PAIRS)}
    after = after_failure(known, PAIR, 2.0)
    assert len(after) == MOST_PAIRS
    assert PAIR in after
    assert ("name-0", "10.0.0.7") not in after
