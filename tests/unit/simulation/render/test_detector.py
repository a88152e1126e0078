"""The detector: how much noise, how correlated, and where its light goes."""

from dataclasses import replace

import numpy as np
import pytest

from simulation.render import detector
from tests.unit.simulation import rooms

FLAT = np.full((256, 256), 0.05, np.float32)


def test_white_noise_follows_the_quanta() -> None:
    exposure = replace(rooms.scenario().exposure, photons_per_px=400.0)
    noisy = detector.with_quantum_noise(FLAT, exposure, np.random.default_rng(0))
    assert np.std(noisy) / np.mean(noisy) == pytest.approx(1.0 / 20.0, rel=0.03)


def test_dark_areas_have_less_noise_but_more_of_it_relative_to_the_signal() -> None:
    signal = FLAT.copy()
    signal[:, :100] = 0.0125
    exposure = replace(rooms.scenario().exposure, photons_per_px=400.0)
    noisy = detector.with_quantum_noise(signal, exposure, np.random.default_rng(0))
    dark, bright = np.std(noisy[:, :100]), np.std(noisy[:, 100:])
    assert dark / bright == pytest.approx(0.5, rel=0.05)


def test_detected_noise_is_correlated_over_two_to_three_pixels() -> None:
    exposure = replace(rooms.scenario().exposure, blur_px=1.15, tail_px=2.8, tail_share=0.3, glare_share=0.0)
    white = np.random.default_rng(1).standard_normal((512, 512)).astype(np.float32)
    blurred = detector.detected(white, exposure, 0.235)
    lags = [float(np.mean(blurred[:, :-k] * blurred[:, k:]) / np.var(blurred)) for k in (1, 2, 3)]
    assert lags == pytest.approx([0.8, 0.55, 0.35], abs=0.12)


def test_light_is_kept() -> None:
    exposure = replace(rooms.scenario().exposure, glare_share=0.08, glare_mm=5.0)
    dot = np.zeros((256, 256), np.float32)
    dot[120:136, 120:136] = 1.0
    assert detector.detected(dot, exposure, 0.94).sum() == pytest.approx(dot.sum(), rel=0.01)


def test_glare_fills_the_middle_of_a_dark_disc() -> None:
    exposure = replace(rooms.scenario().exposure, blur_px=1.0, tail_share=0.0, glare_share=0.06, glare_mm=20.0)
    image = np.ones((256, 256), np.float32)
    image[100:156, 100:156] = 0.0
    assert 0.02 < detector.detected(image, exposure, 0.94)[128, 128] < 0.06


def test_scatter_adds_its_share_of_the_primary() -> None:
    exposure = replace(rooms.scenario().exposure, scatter_to_primary=0.1)
    np.testing.assert_allclose(detector.with_scatter(FLAT, exposure, 0.94), 1.1 * FLAT, rtol=1e-4)


def test_smear_keeps_the_light_and_widens_a_dot() -> None:
    dot = np.zeros((101, 101), np.float32)
    dot[50, 50] = 1.0
    smeared = detector.smeared(dot, 12.0, np.random.default_rng(3))
    assert smeared.sum() == pytest.approx(1.0, rel=1e-4)
    rows, columns = np.nonzero(smeared > 0.02)
    extent = np.hypot(np.ptp(rows), np.ptp(columns))
    assert 9.0 < extent < 14.0
