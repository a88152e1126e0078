"""A piece of `distalock bench guide_calibration`: the guide on the head from eight rendered images."""

import pytest

from benchmarks.guide_calibration import rendered_result


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_eight_images_tell_how_the_head_holds_the_guide() -> None:
    seed = 600
    result = rendered_result(seed)
    print(result)
    assert result.reasons == ()
    assert result.error_mm < 0.25
    assert result.error_deg < 0.15
    assert result.normalised < 4.0
