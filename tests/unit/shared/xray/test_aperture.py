import numpy as np
import pytest

from shared.xray.aperture import find_usable_area, usable_pixels


def test_the_round_aperture_of_an_intensifier_is_found_although_dark_metal_reaches_its_rim() -> None:
    y, x = np.mgrid[0:600, 0:700]
    pixels = np.where(np.hypot(x - 340.0, y - 310.0) < 270.0, 200.0, 3.0).astype(np.float32)
    pixels[:, 300:360] *= 0.2
    area = find_usable_area(pixels)
    assert area.aperture is not None
    assert area.aperture.centre_px == pytest.approx((340.0, 310.0), abs=1.0)
    assert area.aperture.radius_px == pytest.approx(270.0, abs=1.5)
    assert area.mask[310, 340]
    assert not area.mask[310, 340 - 269]


def test_a_flat_panel_is_usable_everywhere() -> None:
    pixels = np.random.default_rng(3).uniform(100.0, 200.0, (400, 400)).astype(np.float32)
    area = find_usable_area(pixels)
    assert area.aperture is None
    assert area.mask.all()


def test_straight_collimator_blades_leave_a_rectangle() -> None:
    pixels = np.zeros((400, 500), np.float32)
    pixels[80:330, 120:] = 150.0
    area = find_usable_area(pixels)
    assert area.aperture is None
    assert area.mask[200, 300]
    assert not area.mask[40, 300]
    assert not area.mask[200, 60]


def test_burnt_in_text_beside_the_aperture_is_not_usable() -> None:
    y, x = np.mgrid[0:512, 0:512]
    pixels = np.where(np.hypot(x - 255.5, y - 255.5) < 240.0, 180.0, 0.0).astype(np.float32)
    pixels[10:20, 10:60:7] = 255.0
    assert not find_usable_area(pixels).mask[10:20, 10:60].any()


@pytest.mark.parametrize("shape", ["round", "rectangle", "whole"])
def test_usable_pixels_are_those_that_were_found_whether_or_not_the_aperture_is_known(shape: str) -> None:
    y, x = np.mgrid[0:512, 0:512]
    light = {"round": np.hypot(x - 250.0, y - 260.0) < 230.0, "rectangle": (x > 100) & (y < 400), "whole": x >= 0}
    bright = np.random.default_rng(4).uniform(100.0, 200.0, x.shape)
    pixels = np.where(light[shape], bright, 0.0).astype(np.float32)
    area = find_usable_area(pixels)
    assert (area.aperture is not None) is (shape == "round")
    assert np.array_equal(usable_pixels(pixels, area.aperture), area.mask)
