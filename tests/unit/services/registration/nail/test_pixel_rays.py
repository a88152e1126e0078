"""Where pixels are looked at."""

from itertools import product

import numpy as np
import pytest

from services.registration.core.nail.pixel_rays import FIRST_SAMPLES, SAMPLES_PX


def moment_of_a_pixel(column: int, row: int) -> float:
    """Mean of x ** column * y ** row over a square of side one about zero."""
    if column % 2 or row % 2:
        return 0.0
    return float(0.5**column / (column + 1) * 0.5**row / (row + 1))


@pytest.mark.parametrize(("samples", "degree"), [(FIRST_SAMPLES, 3), (len(SAMPLES_PX), 5)])
def test_places_have_a_whole_pixels_moments(samples: int, degree: int) -> None:
    x, y = SAMPLES_PX[:samples].T
    for column, row in product(range(degree + 1), repeat=2):
        if column + row <= degree:
            found = float(np.mean(x**column * y**row))
            assert found == pytest.approx(moment_of_a_pixel(column, row), abs=1e-5), (column, row)


def test_places_lie_in_the_pixel_and_apart() -> None:
    assert np.abs(SAMPLES_PX).max() <= 0.5
    apart = np.linalg.norm(SAMPLES_PX[:, None] - SAMPLES_PX, axis=2)
    assert apart[~np.eye(len(SAMPLES_PX), dtype=bool)].min() > 0.15
