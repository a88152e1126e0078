"""The limit against cases whose answer is known without it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.cramer_rao import limits_of, pixel_covariance
from benchmarks.cramer_rao_images import SceneImages
from benchmarks.random_scenes import scene_of_seed
from tests.unit.services.registration.xray_scene import nail_part

SIDE = 30
SCENARIO = scene_of_seed(5003)
SHARP = replace(
    SCENARIO, exposure=replace(SCENARIO.exposure, blur_px=1e-3, tail_px=1e-3, tail_share=0.0, glare_share=0.0)
)


def images(noise: float, texture: float = 0.0) -> SceneImages:
    """A picture on which each of the six motions of the nail acts by a pattern of its own; nothing else is unknown."""
    rng = np.random.default_rng(3)
    derivatives = rng.standard_normal((6, SIDE, SIDE))
    counted = np.zeros((1, SIDE, SIDE), dtype=bool)
    counted[0, 4:26, 5:25] = True
    even = np.ones((SIDE, SIDE))
    samples = texture * rng.standard_normal((4, SIDE, SIDE))
    return SceneImages(counted, derivatives, np.zeros(6), noise**2 * even, 1e-12 * even, even, samples, 6.0, SHARP)


def test_without_texture_it_is_that_of_least_squares() -> None:
    shown, nail = images(noise=0.5), nail_part()
    columns = shown.derivatives[:, shown.counted[0]]
    covariance = np.linalg.inv(columns @ columns.T / 0.25)
    limits = limits_of(shown, nail, smooth_share=0.0)
    expected = np.degrees(np.sqrt(covariance[0, 0] + covariance[1, 1]))
    assert [limit.axis_deg for limit in limits] == pytest.approx([expected] * 2, rel=1e-3)


def test_it_goes_as_the_noise() -> None:
    quiet, loud = (limits_of(images(noise=noise), nail_part(), 0.0)[0] for noise in (0.2, 0.6))
    assert loud.axis_deg == pytest.approx(3.0 * quiet.axis_deg, rel=1e-6)
    assert loud.entry_mm == pytest.approx(3.0 * quiet.entry_mm, rel=1e-6)


def test_texture_and_a_smooth_field_only_take_information_away() -> None:
    plain = limits_of(images(noise=0.3), nail_part(), 0.0)[0]
    textured = limits_of(images(noise=0.3, texture=0.5), nail_part(), 0.0)[0]
    varying = limits_of(images(noise=0.3), nail_part(), 0.5)[0]
    assert textured.axis_deg > 1.2 * plain.axis_deg
    assert varying.axis_deg > plain.axis_deg


def test_the_covariance_is_that_of_the_fields_it_is_made_of() -> None:
    shown = images(noise=0.3, texture=0.5)
    covariance = pixel_covariance(shown, shown.counted[0], 0.2)
    assert covariance == pytest.approx(covariance.T, abs=1e-12)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert np.diag(covariance) == pytest.approx(0.3**2 + 0.5**2 + 0.2**2, rel=0.1)
