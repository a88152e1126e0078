"""Hand-eye calibration of the guide: exact without noise."""

import numpy as np
import pytest

from distalock.guide_calibration.hand_eye import calibrate_guide, view_residual
from tests.unit.distalock.guide_calibration.views import HEXAPOD, NOMINAL, POSES, codes, exact_views, turned


def test_without_noise_the_head_is_found_exactly() -> None:
    head = turned((0.8, -0.5, 1.1), (0.4, -0.6, 0.9))
    views = exact_views(head, POSES)
    found = calibrate_guide(HEXAPOD, views[:-1], NOMINAL)
    np.testing.assert_allclose(found.top_from_guide.matrix, head.matrix, atol=1e-6)
    assert found.normalised_rms < 1e-3
    assert max(view_residual(HEXAPOD, found, views[-1])) < 1e-4
    assert codes(head) == set()


def test_three_views_are_refused() -> None:
    with pytest.raises(ValueError, match="seen in 3 poses, 4 are needed; take more images"):
        calibrate_guide(HEXAPOD, exact_views(NOMINAL, POSES)[:3], NOMINAL)
