"""What part of an image shows something."""

from dataclasses import replace

import numpy as np
import pytest

from shared.geometry.calibration import Aperture
from tests.unit.services.registration.xray_scene import calibration


@pytest.mark.parametrize(
    ("place", "margin_px", "inside"),
    [
        ((130.0, 100.0), 0.0, True),
        ((130.1, 100.0), 0.0, False),
        ((118.0, 124.0), 0.0, True),
        ((118.0, 124.0), 0.1, False),
        ((100.0, 75.0), 5.0, True),
        ((100.0, 74.9), 5.0, False),
    ],
)
def test_an_aperture_holds_places_up_to_its_rim_less_a_margin(
    place: tuple[float, float], margin_px: float, *, inside: bool
) -> None:
    aperture = Aperture((100.0, 100.0), 30.0)
    assert bool(aperture.holds(np.array(place[0]), np.array(place[1]), margin_px)) == inside


def test_an_image_shows_what_is_within_its_border_and_its_aperture() -> None:
    plain = calibration(200)
    columns, rows = np.arange(-5.0, 205.0), np.arange(-5.0, 205.0)[:, None]
    shown = plain.shows(columns, rows, 6.0)
    assert shown.shape == (210, 210)
    assert shown.sum() == (200 - 12) ** 2
    assert shown[5 + 6, 5 + 6]
    round_one = replace(plain, aperture=Aperture((20.0, 100.0), 50.0)).shows(columns, rows, 6.0)
    in_circle = np.hypot(columns - 20.0, rows - 100.0) <= 44.0
    assert (round_one == (shown & in_circle)).all()
    assert in_circle.sum() > round_one.sum() > 0


def test_the_pixel_pitch_is_what_a_millimetre_on_the_ring_s_plate_spans() -> None:
    plain = calibration(200)
    ring_from_camera = plain.camera_from_ring.inverse()
    foot = ring_from_camera.points(np.zeros((1, 3)))[0]
    plate = np.array([[foot[0], foot[1], 0.0], [foot[0] + 10.0, foot[1], 0.0]])
    ends = plain.camera.project(plain.camera_from_ring.points(plate))
    assert 10.0 / np.hypot(*(ends[1] - ends[0])) == pytest.approx(plain.pixel_mm, rel=1e-6)
