"""The figures of the benchmark of starts, from times that are known."""

import pytest

from benchmarks.bus.start import Kind, longer_s, page

# In the second round the machine was twice as slow, for all.
SECONDS: dict[Kind, list[float]] = {
    "plain": [10.0, 20.0, 10.0],
    "first": [10.2, 20.5, 10.3],
    "later": [10.1, 20.2, 9.9],
}


def test_a_slow_round_does_not_change_the_difference() -> None:
    assert longer_s(SECONDS, "first") == pytest.approx(0.3)
    assert longer_s(SECONDS, "later") == pytest.approx(0.1)


def test_the_page_states_medians_differences_and_the_limit() -> None:
    text = page(SECONDS)
    assert "3 rounds of three starts" in text
    assert "| the first start: all certificates are made | 10.30 s | 10.20 s | 20.50 s | +0.30 s | 1.02 |" in text
    assert "| limit | | | | 1.00 s | |" in text
