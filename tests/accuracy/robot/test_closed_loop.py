"""A piece of `distalock bench robot_closed_loop`: one more move corrects a wrong calibration and a yielding mount."""

import pytest

from benchmarks.robot.closed_loop import LIMIT_DEG, LIMIT_MM, Trouble, run_case

SEED = 330


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("trouble", list(Trouble))
def test_one_more_move_corrects_what_the_first_left(trouble: Trouble) -> None:
    result = run_case(SEED, trouble)
    print(result)
    assert result.refusal == ""
    assert result.errors[0].entry_mm > 1.0
    assert result.errors[2].entry_mm <= 2.0 * LIMIT_MM
    assert result.errors[2].angle_deg <= 1.5 * LIMIT_DEG
