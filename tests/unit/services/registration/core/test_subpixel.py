"""Bilinear sampling, subpixel peaks and gradual weights."""

import numpy as np
import pytest
from scipy.special import ndtr

from services.registration.core.subpixel import linear_ramp, profile_offsets_px, sample_bilinear, subpixel_peaks


def test_values_sample_bilinear_are_linear_and_beyond_the_border_its_own() -> None:
    picture = np.add.outer(10.0 * np.arange(6.0), np.arange(8.0)).astype(np.float32)
    points = np.array([[[2.5, 1.25], [0.0, 5.0]], [[-40.0, 2.0], [9.0, 90.0]]])
    assert sample_bilinear(picture, points) == pytest.approx(np.array([[15.0, 50.0], [20.0, 57.0]]))
    assert sample_bilinear(picture, points[0]).shape == (2,)
    assert sample_bilinear(picture, np.zeros((0, 2))).shape == (0,)


def test_a_peak_is_the_vertex_of_its_parabola() -> None:
    places = np.arange(-4.0, 4.1, 0.5)
    vertex = np.array([-2.3, 0.0, 1.7])
    peaks = subpixel_peaks(5.0 - (places - vertex[:, None]) ** 2, places)
    assert peaks.position == pytest.approx(vertex)
    assert peaks.interior.all()
    assert peaks.height == pytest.approx(5.0, abs=0.07)


@pytest.mark.parametrize("samples", [np.arange(9.0), np.arange(9.0)[::-1]])
def test_a_profile_that_rises_to_its_end_has_no_interior_peak(samples: np.ndarray) -> None:
    peaks = subpixel_peaks(samples[None], np.linspace(-2.0, 2.0, 9))
    assert not peaks.interior[0]
    assert abs(peaks.position[0]) <= 2.0


def test_a_flat_profile_has_its_peak_within_the_samples() -> None:
    assert abs(subpixel_peaks(np.zeros((1, 5)), np.linspace(-1.0, 1.0, 5)).position[0]) <= 1.0


def test_a_ramp_is_zero_then_linear_then_one() -> None:
    assert linear_ramp(np.array([-1.0, 0.3, 0.35, 0.4, 7.0]), 0.3, 0.4) == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.0])


@pytest.mark.parametrize("slant_deg", [0.0, 3.0, 20.0, 45.0])
def test_edges_are_not_biased_towards_pixels(slant_deg: float) -> None:
    """An edge as soft as images are made, at all fractions of a pixel, sampled across itself."""
    normal = np.array([np.cos(np.radians(slant_deg)), np.sin(np.radians(slant_deg))])
    y, x = np.mgrid[:60, :60]
    off_px = []
    for fraction in np.arange(0.0, 1.0, 0.1):
        across = (x - 30.0 - fraction) * normal[0] + (y - 30.0) * normal[1]
        picture = ndtr(across / 1.5).astype(np.float32)
        along = np.arange(-8.0, 8.0, 0.37)[:, None, None] * np.array([-normal[1], normal[0]])
        shifts = profile_offsets_px(4.5)
        points = np.array([30.0 + fraction, 30.0]) + along + shifts[:, None] * normal
        before, after = (sample_bilinear(picture, points + way * normal) for way in (-1.0, 1.0))
        off_px.append(subpixel_peaks(after - before, shifts).position)
    assert float(np.sqrt(np.mean(np.square(off_px)))) < 0.04
