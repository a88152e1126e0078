"""How well a view suits, what a degree less buys, and which way to the middle."""

import numpy as np
import pytest

from services.registration.core.alignment import ViewQuality, assess, off_centre_mm, shift_in_room_mm
from services.registration.core.c_arm_advice import CArmAngles, HoleTilt
from tests.unit.services.registration.rendered_case import SIZE_PX
from tests.unit.services.registration.xray_scene import calibration


def tilted(*degrees: float) -> tuple[HoleTilt, ...]:
    return tuple(HoleTilt(str(deg), deg, deg, 0.0) for deg in degrees)


@pytest.mark.parametrize(
    ("degrees", "quality"),
    [((1.0, 4.9), ViewQuality.GOOD), ((2.0, 5.1), ViewQuality.USABLE), ((13.0, 14.1), ViewQuality.TOO_FAR)],
)
def test_the_hole_that_is_tilted_most_decides(degrees: tuple[float, ...], quality: ViewQuality) -> None:
    found = assess(tilted(*degrees))
    assert found.quality is quality
    assert found.largest_tilt_deg == degrees[-1]


def test_a_degree_less_saves_the_less_the_more_tilt_there_is_and_nothing_without_tilt() -> None:
    assert assess(tilted(0.0)).saved_by_a_degree == 0.0
    far, near = assess(tilted(12.0)).saved_by_a_degree, assess(tilted(2.0)).saved_by_a_degree
    assert 0.0 < far < near < 0.11


def test_a_point_beside_the_middle_is_so_far_off() -> None:
    view = calibration(SIZE_PX)
    aperture = view.aperture
    middle_px = np.full(2, 0.5 * (SIZE_PX - 1)) if aperture is None else np.array(aperture.centre_px)
    ray = view.rays_camera(middle_px)
    beside_mm = ray * (700.0 / ray[2]) + np.array([12.0, -5.0, 0.0])
    assert off_centre_mm(view, beside_mm) == pytest.approx([12.0, -5.0])


def test_in_a_lateral_view_the_pictures_axes_are_table_and_height() -> None:
    """The detector at the patient's left: right of the picture is along the table, down of it along the vertical."""
    lateral = CArmAngles(orbital_deg=90.0, angular_deg=0.0)
    assert shift_in_room_mm(np.array([10.0, 0.0]), lateral, 0.0) == pytest.approx([10.0, 0.0, 0.0])
    assert shift_in_room_mm(np.array([0.0, 10.0]), lateral, 0.0) == pytest.approx([0.0, 0.0, 10.0])
    assert shift_in_room_mm(np.array([10.0, 0.0]), lateral, np.pi / 2.0) == pytest.approx([0.0, 0.0, 10.0])
