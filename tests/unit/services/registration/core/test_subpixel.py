"""Reading between pixels and counting by degrees."""

import numpy as np
import pytest
from scipy.special import ndtr

from services.registration.core.subpixel import between_pixels, peaks_of, profile_px, ramp


def test_values_between_pixels_are_linear_and_beyond_the_border_its_own() -> None:
    picture = np.add.outer(10.0 * np.arange(6.0), np.arange(8.0)).astype(np.float32)
    points = np.array([[[2.5, 1.25], [0.0, 5.0]], [[-40.0, 2.0], [9.0, 90.0]]])
    assert between_pixels(picture, points) == pytest.approx(np.array([[15.0, 50.0], [20.0, 57.0]]))
    assert between_pixels(picture, points[0]).shape == (2,)
    assert between_pixels(picture, np.zeros((0, 2))).shape == (0,)


def test_a_peak_is_the_vertex_of_its_parabola() -> None:
    places = np.arange(-4.0, 4.1, 0.5)
    vertex = np.array([-2.3, 0.0, 1.7])
    peaks = peaks_of(5.0 - (places - vertex[:, None]) ** 2, places)
    assert peaks.place == pytest.approx(vertex)
    assert peaks.inside.all()
    assert peaks.height == pytest.approx(5.0, abs=0.07)


@pytest.mark.parametrize("samples", [np.arange(9.0), np.arange(9.0)[::-1]])
def test_what_rises_to_the_end_has_no_peak_inside(samples: np.ndarray) -> None:
    peaks = peaks_of(samples[None], np.linspace(-2.0, 2.0, 9))
    assert not peaks.inside[0]
    assert abs(peaks.place[0]) <= 2.0


def test_what_is_flat_has_a_place_among_the_samples() -> None:
    assert abs(peaks_of(np.zeros((1, 5)), np.linspace(-1.0, 1.0, 5)).place[0]) <= 1.0


def test_a_ramp_counts_nothing_then_by_degrees_then_whole() -> None:
    assert ramp(np.array([-1.0, 0.3, 0.35, 0.4, 7.0]), 0.3, 0.4) == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.0])


@pytest.mark.parametrize("slant_deg", [0.0, 3.0, 20.0, 45.0])
def test_edges_are_not_drawn_to_pixels(slant_deg: float) -> None:
    """An edge as soft as images are made, at all fractions of a pixel, read across itself."""
    normal = np.array([np.cos(np.radians(slant_deg)), np.sin(np.radians(slant_deg))])
    y, x = np.mgrid[:60, :60]
    off_px = []
    for fraction in np.arange(0.0, 1.0, 0.1):
        across = (x - 30.0 - fraction) * normal[0] + (y - 30.0) * normal[1]
        picture = ndtr(across / 1.5).astype(np.float32)
        along = np.arange(-8.0, 8.0, 0.37)[:, None, None] * np.array([-normal[1], normal[0]])
        shifts = profile_px(4.5)
        points = np.array([30.0 + fraction, 30.0]) + along + shifts[:, None] * normal
        before, after = (between_pixels(picture, points + way * normal) for way in (-1.0, 1.0))
        off_px.append(peaks_of(after - before, shifts).place)
    assert float(np.sqrt(np.mean(np.square(off_px)))) < 0.04
