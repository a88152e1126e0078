"""A few trials of `distalock bench stop_latency`: from REST to the controller's wire, with real processes."""

import pytest

from benchmarks.robot.stop_latency import LIMIT_P99_S, LIMIT_WORST_S, measured, quantile_s

TRIALS = 20


@pytest.mark.requirement("ROB-03")
@pytest.mark.slow
@pytest.mark.alone
@pytest.mark.timeout(600)
def test_a_stop_over_rest_reaches_the_wire_at_once_in_motion_and_with_a_mute_controller() -> None:
    latencies = measured(TRIALS, seed=78)
    print(f"90 % {quantile_s(latencies.all_s, 90.0):.4f} s, worst {max(latencies.all_s):.4f} s")
    assert len(latencies.all_s) == TRIALS
    # The requirement: no trial may miss it.
    assert max(latencies.all_s) <= LIMIT_WORST_S
    # The bench holds 99 % to its own limit on a machine that does nothing else; here the other core may be busy.
    assert quantile_s(latencies.all_s, 90.0) <= LIMIT_P99_S
