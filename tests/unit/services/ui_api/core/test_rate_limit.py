"""Token buckets: what is granted at once, on the long run, and to whom."""

import pytest

from services.ui_api.core.rate_limit import BURST_S, Buckets


def granted(buckets: Buckets, key: str, times: int, now_s: float) -> int:
    return sum(buckets.wait_s(key, now_s) == 0.0 for _ in range(times))


def test_a_burst_then_the_rate() -> None:
    buckets = Buckets(5.0)
    assert granted(buckets, "a", 100, 0.0) == 5 * BURST_S
    assert granted(buckets, "a", 100, 1.0) == 5
    assert buckets.wait_s("a", 1.0) == pytest.approx(0.2)
    assert buckets.wait_s("a", 1.21) == 0.0


def test_who_was_refused_is_not_charged() -> None:
    buckets = Buckets(1.0)
    granted(buckets, "a", 1000, 0.0)
    assert buckets.wait_s("a", 1.0) == 0.0


def test_one_does_not_pay_for_another() -> None:
    buckets = Buckets(1.0)
    granted(buckets, "a", 1000, 0.0)
    assert buckets.wait_s("b", 0.0) == 0.0


def test_no_rate_is_no_limit_and_keeps_nothing() -> None:
    buckets = Buckets(0.0)
    assert granted(buckets, "a", 10_000, 0.0) == 10_000
    assert len(buckets) == 0


def test_memory_is_bounded() -> None:
    buckets = Buckets(1.0)
    for number in range(10_000):
        buckets.wait_s(str(number), 0.0)
    assert len(buckets) < 5000
