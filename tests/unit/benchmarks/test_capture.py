"""An end of the search is right when no hole's axis is off by more than an accepted one may be."""

import numpy as np
import pytest

from benchmarks.accuracy.capture import is_right
from shared.geometry.frames import Nail, Ring
from shared.geometry.transform import Transform
from tests.unit.services.registration.xray_scene import nail_part

TRUE: Transform[Ring, Nail] = Transform.from_rotvec(np.array([0.1, -0.2, 0.7]), np.array([3.0, -8.0, -200.0]))


@pytest.mark.parametrize(
    ("turn_deg", "shift_mm", "right"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), True),
        ((1.4, 0.0, 0.0), (0.0, 0.0, 0.0), True),
        ((1.6, 0.0, 0.0), (0.0, 0.0, 0.0), False),
        ((0.0, 5.0, 0.0), (0.0, 0.0, 0.0), False),
        ((0.0, 0.0, 0.0), (0.0, 0.9, 0.0), True),
        ((0.0, 0.0, 0.0), (0.8, 0.8, 0.0), False),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 4.0), True),
    ],
)
def test_only_what_counts_for_a_drill_counts(
    turn_deg: tuple[float, float, float],
    shift_mm: tuple[float, float, float],
    right: bool,  # noqa: FBT001  # expected value
) -> None:
    off: Transform[Nail, Nail] = Transform.from_rotvec(np.radians(turn_deg), np.array(shift_mm))
    assert is_right(nail_part(), TRUE @ off, TRUE) is right
