"""Stubs of wires in the nail's openings are found, known balls and clear openings are not."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.search.find import find_nail
from services.registration.core.nail.search.outline import covered_pixels
from shared.errors import Accepted
from tests.unit.services.registration.xray_scene import Rod, Scene, calibration, nail_part, posed_nail, render

SIZE_PX = 560
NAIL, POSE = nail_part(), posed_nail(40.0)
NO_DISCS = np.zeros((0, 3))


def covered(
    known: NDArray[np.float64], rods: tuple[Rod, ...] = (), balls: NDArray[np.float64] | None = None
) -> NDArray[np.bool_]:
    view = calibration(SIZE_PX)
    there = np.zeros((0, 4)) if balls is None else balls
    pixels = render(Scene(SIZE_PX, NAIL, POSE, rods, there, texture=0.03), view, seed=51)
    start = find_nail(pixels, view, NAIL)
    assert isinstance(start, Accepted), start
    return covered_pixels(pixels, view, start.value.openings, 740.0, known)


def stub() -> tuple[Rod, NDArray[np.float64]]:
    """A wire that ends at the rim of the distal hole, and where its end appears in the image."""
    points = POSE.points(np.array([[15.5, 2.4, -6.0], [16.5, 4.5, -110.0]]))
    return Rod(points[0], points[1], 2.0), calibration(SIZE_PX).image_from_camera(points[:1])[0]


def test_a_wires_stub_is_covered_with_its_surroundings() -> None:
    rod, (x, y) = stub()
    mask = covered(NO_DISCS, rods=(rod,))
    assert mask[round(y), round(x)]
    proximal_x, proximal_y = calibration(SIZE_PX).image_from_camera(POSE.points(np.array([[-15.0, 0.0, 0.0]])))[0]
    assert not mask[round(proximal_y), round(proximal_x)]
    # The stub, less than a wire's width inside the rim, and 1.45 mm around it: no more than a third of an opening more.
    assert 100 < np.count_nonzero(mask) < 1500


def test_clear_openings_are_not_covered() -> None:
    assert not covered(NO_DISCS).any()


def test_a_ball_is_covered_unless_it_is_known() -> None:
    # On the ray to the opening, 110 mm nearer to the source.
    place = POSE.points(np.array([[15.0, 1.5, 0.0]])) * (630.0 / 740.0)
    ball = np.column_stack([place, [2.0]])
    x, y = calibration(SIZE_PX).image_from_camera(place)[0]
    assert covered(NO_DISCS, balls=ball)[round(y), round(x)]
    assert not covered(np.array([[x, y, 6.7]]), balls=ball).any()
