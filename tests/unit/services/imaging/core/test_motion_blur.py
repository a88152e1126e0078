"""How far a C-arm moved, read from the balls' shapes."""

import numpy as np
import pytest

from services.imaging.core.motion_blur import motion_blur_px
from tests.unit.services.imaging.moved_balls import balls, moved_image


@pytest.mark.parametrize(("length_px", "angle_deg"), [(4.5, 0.0), (3.5, 35.0), (4.0, 120.0)])
def test_the_length_of_a_movement_is_read_in_any_direction(length_px: float, angle_deg: float) -> None:
    assert motion_blur_px(moved_image(length_px, angle_deg), *balls()) == pytest.approx(length_px, rel=0.1)


def test_still_balls_did_not_move() -> None:
    assert motion_blur_px(moved_image(0.0, 0.0), *balls()) < 1.0


def test_too_few_balls_tell_nothing_and_those_cut_by_the_border_do_not_count() -> None:
    centre, radius = balls()
    pixels = moved_image(4.5, 0.0)
    assert motion_blur_px(pixels, centre[:11], radius[:11]) == 0.0
    cut = np.ascontiguousarray(pixels[:200])
    assert motion_blur_px(cut, centre[:12], radius[:12]) == pytest.approx(4.5, rel=0.1)
    assert motion_blur_px(np.ascontiguousarray(cut[:, :190]), centre[:12], radius[:12]) == 0.0


def test_bright_discs_are_no_shadows() -> None:
    assert motion_blur_px(np.asarray(2000.0 - moved_image(4.5, 0.0), dtype=np.float32), *balls()) == 0.0
