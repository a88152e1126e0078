"""Lengths at the detector in pixels of images of different pitches."""

import numpy as np
import pytest

from shared.xray.pixel_scale import USUAL_PIXEL_MM, pixels, quantised_pitch_mm, whole_pixels


@pytest.mark.parametrize("pixel_mm", [0.2, 0.229, 0.235, 0.25, 0.278])
@pytest.mark.parametrize("usual_px", [0.35, 1.5, 6.0, 7.0, 32.0])
def test_images_of_about_the_usual_pitch_get_exactly_the_chosen_pixels(pixel_mm: float, usual_px: float) -> None:
    assert pixels(round(usual_px * USUAL_PIXEL_MM, 6), pixel_mm) == usual_px


@pytest.mark.parametrize(("pixel_mm", "factor"), [(0.1175, 2.0), (0.125, 2.0), (0.15, 2.0**0.5), (0.47, 0.5)])
def test_finer_images_get_more_pixels_for_the_same_length(pixel_mm: float, factor: float) -> None:
    assert pixels(1.41, pixel_mm) == pytest.approx(6.0 * factor, abs=1e-8)


def test_the_quantised_pitch_is_within_a_quarter_octave_of_the_image() -> None:
    for pixel_mm in np.geomspace(0.02, 2.0, 200):
        assert abs(np.log2(quantised_pitch_mm(float(pixel_mm)) / pixel_mm)) <= 0.25 + 1e-12


def test_whole_pixels_are_rounded_and_never_vanish() -> None:
    assert whole_pixels(1.41, 0.235) == 6
    assert whole_pixels(1.41, 0.167) == 8
    assert whole_pixels(0.05, 0.235) == 1


@pytest.mark.parametrize("pixel_mm", [0.0, -0.2, float("nan"), float("inf")])
def test_a_pitch_that_is_no_length_is_refused(pixel_mm: float) -> None:
    with pytest.raises(ValueError, match="a pixel pitch is a positive number of millimetres"):
        quantised_pitch_mm(pixel_mm)
