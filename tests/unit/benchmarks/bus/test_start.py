"""The figures of the benchmark of starts, from times that are known."""

import pytest

from benchmarks.bus.start import Kind, Start, longer_s, page

# In the second round the machine was twice as slow, for all.
READY_S: dict[Kind, list[float]] = {
    "plain": [10.0, 20.0, 10.0],
    "first": [10.2, 20.5, 10.3],
    "later": [10.1, 20.2, 9.9],
}
STARTS = {kind: [Start(ready_s, 5.0 + (kind != "plain") * 0.1) for ready_s in own] for kind, own in READY_S.items()}


def test_a_slow_round_does_not_change_the_difference() -> None:
    assert longer_s(STARTS, "first") == pytest.approx(0.3)
    assert longer_s(STARTS, "later") == pytest.approx(0.1)


def test_the_page_states_medians_differences_and_the_limit() -> None:
    text = page(STARTS)
    assert "3 rounds of three starts" in text
    first = "| the first start: all certificates are made | 10.30 s | 10.20 s | 20.50 s |"
    assert f"{first} +0.30 s | 1.02 | 5.10 s | +0.10 s |" in text
    assert "| limit | | | | 1.00 s | | | |" in text
