"""How far a C-arm moved, read from the balls' shapes."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from services.imaging.core.motion_blur import motion_blur_px

SIDE_PX, SPACING_PX, RADIUS_PX = 256, 48, 5.0


def balls() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres and radii of a grid of sixteen, none at a whole pixel."""
    x, y = np.meshgrid(np.arange(4), np.arange(4))
    centre = SPACING_PX * np.column_stack([x.ravel(), y.ravel()]) + np.array([50.3, 51.8])
    return centre, np.full(len(centre), RADIUS_PX)


def moved_image(length_px: float, angle_deg: float) -> NDArray[np.float32]:
    """Balls on a slope of grey, averaged over a straight movement about their places."""
    centre, radius = balls()
    y, x = np.mgrid[:SIDE_PX, :SIDE_PX].astype(np.float64)
    along = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    total = np.zeros((SIDE_PX, SIDE_PX))
    steps = np.linspace(-0.5, 0.5, 41)
    for step in steps:
        image = 1000.0 + 0.8 * x - 0.5 * y
        for (u, v), r in zip(centre + step * length_px * along, radius, strict=True):
            image -= 300.0 * np.clip(0.5 - (np.hypot(x - u, y - v) - r), 0.0, 1.0)
        total += image
    return np.asarray(cv2.GaussianBlur(total / len(steps), (0, 0), 0.7), dtype=np.float32)


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
