"""Which wires can be beyond the nail's near surface: those that meet its hole, and those beside it."""

import numpy as np
import pytest

from services.registration.core.wires.model import NailPassage, wire_model
from tests.unit.services.registration.xray_scene import guide_part

PASSAGE = NailPassage(np.array([3.0, 1.0]), 1.5, np.array([0.0, 1.0]), 7.0)


@pytest.mark.parametrize(
    ("offset_mm", "interference_mm"),
    [
        ((3.0, 1.0), 0.0),  # in the middle of the hole
        ((4.4, 1.0), 0.0),  # at its rim
        ((5.5, 1.0), 1.0),  # on the nail, along it
        ((3.0, 7.5), 0.5),  # on the nail's side, nearer to its edge than to the hole
        ((3.0, 8.5), 0.0),  # beside the nail
    ],
)
def test_a_wire_passes_in_the_hole_or_beside_the_nail(offset_mm: tuple[float, float], interference_mm: float) -> None:
    assert PASSAGE.interference_mm(np.array(offset_mm)) == pytest.approx(interference_mm)


def test_a_wire_ends_at_the_nail_or_well_beyond() -> None:
    guide = guide_part()
    stopped, passed = (wire_model(guide, guide.holes[0], 2.0, 110.0, way) for way in (None, PASSAGE))
    assert stopped.passage is None
    assert passed.passage is PASSAGE
    assert passed.mean[5] - stopped.mean[5] > 2.0 * stopped.tip_sd_mm
    assert stopped.latest_start_mm == pytest.approx(-12.5)  # where the guide's body begins
