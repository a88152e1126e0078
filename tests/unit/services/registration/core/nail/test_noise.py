"""Noise from residuals: variance, correlation, and the filter against it."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from services.registration.core.nail.noise import (
    covariance_of_sums,
    huber_precision,
    noise_correlation,
    variance_by_brightness,
    whitening_filter,
)

SHAPE = (160, 180)
EVERYWHERE = np.arange(SHAPE[0] * SHAPE[1])


def blurred_noise(sigma: float, seed: int) -> NDArray[np.float64]:
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=SHAPE), sigma)
    return np.asarray(noise / noise.std())


def test_independent_noise_has_no_inflation() -> None:
    white = np.random.default_rng(1).normal(size=SHAPE)
    assert noise_correlation(white.ravel(), EVERYWHERE, SHAPE).inflation == pytest.approx(1.0, abs=0.25)


def test_blurred_noise_inflates_by_the_area_of_its_correlation() -> None:
    noise = blurred_noise(1.2, 2)
    # the autocorrelation of noise blurred by s is a Gaussian of s * sqrt(2): its area is 4 pi s^2
    inflation = noise_correlation(noise.ravel(), EVERYWHERE, SHAPE).inflation
    assert inflation == pytest.approx(4.0 * np.pi * 1.2**2, rel=0.25)


def test_whitening_takes_most_of_the_correlation_and_leaves_slow_variations() -> None:
    noise = blurred_noise(1.0, 3)
    before = noise_correlation(noise.ravel(), EVERYWHERE, SHAPE)
    whitening = whitening_filter(before, before, np.full(SHAPE, 0.5))
    after = noise_correlation(whitening.apply(noise).ravel().astype(np.float64), EVERYWHERE, SHAPE)
    assert after.inflation < 0.5 * before.inflation
    slope = np.tile(np.linspace(1.0, 3.0, SHAPE[1]), (SHAPE[0], 1))
    assert np.abs(whitening.apply(slope) - slope)[20:-20, 20:-20].max() < 1e-3


def test_dark_and_bright_places_are_whitened_each_by_their_own() -> None:
    dark, bright = np.arange(EVERYWHERE.size // 2), np.arange(EVERYWHERE.size // 2, EVERYWHERE.size)
    noise = blurred_noise(1.0, 6).ravel()
    noise[dark] = np.random.default_rng(7).normal(size=len(dark))
    of_dark, of_bright = (noise_correlation(noise[kind], kind, SHAPE) for kind in (dark, bright))
    brightness = np.zeros(SHAPE)
    brightness.ravel()[bright] = 1.0
    filtered = whitening_filter(of_dark, of_bright, brightness).apply(noise.reshape(SHAPE)).ravel().astype(np.float64)
    assert noise_correlation(filtered[bright], bright, SHAPE).inflation < 0.5 * of_bright.inflation
    assert np.corrcoef(filtered[dark], noise[dark])[0, 1] > 0.98


def test_a_filter_after_another_does_what_both_do() -> None:
    noise = blurred_noise(1.0, 9)
    of_noise = noise_correlation(noise.ravel(), EVERYWHERE, SHAPE)
    whitening = whitening_filter(of_noise, of_noise, np.full(SHAPE, 0.5))

    def smoothed(picture: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(gaussian_filter(picture, 1.7, mode="nearest"), dtype=np.float32)

    once = whitening.after(smoothed).apply(noise)
    assert np.abs(once - whitening.apply(smoothed(noise.astype(np.float32))))[20:-20, 20:-20].max() < 1e-4 * once.std()


def test_variance_follows_brightness() -> None:
    rng = np.random.default_rng(4)
    modelled = rng.uniform(0.2, 1.0, 20000)
    variance = variance_by_brightness(rng.normal(0.0, 0.1 * modelled), modelled)
    assert np.abs(np.sqrt(variance) / (0.1 * modelled) - 1.0).max() < 0.25


def test_outliers_weigh_less_than_their_variance_says() -> None:
    weight = huber_precision(np.array([0.5, 3.0, 30.0]), np.full(3, 4.0))
    assert weight == pytest.approx([0.25, 0.25, 0.25 * 3.0 / 15.0])


def test_covariance_of_sums_is_that_of_many_draws() -> None:
    rng = np.random.default_rng(8)
    images = np.stack([np.outer(np.hanning(160), np.sin(np.arange(180) / width)) for width in (1.5, 9.0)])
    noises = np.stack([blurred_noise(1.0, seed) for seed in range(300)])
    bright = noise_correlation(noises[0].ravel(), EVERYWHERE, SHAPE)
    dark = noise_correlation(rng.normal(size=SHAPE).ravel(), EVERYWHERE, SHAPE)
    brightness = np.tile(np.linspace(0.0, 1.0, 160)[:, None], (1, 180))
    mixed = np.sqrt(brightness) * noises + np.sqrt(1.0 - brightness) * rng.normal(size=noises.shape)
    sums = np.einsum("kij,nij->nk", images, mixed)
    foretold = covariance_of_sums(images, ((dark, 1.0 - brightness), (bright, brightness)))
    assert np.sqrt(np.diag(foretold)) == pytest.approx(sums.std(axis=0), rel=0.2)


def test_pixels_too_few_for_classes_of_brightness_are_one_class() -> None:
    """Wires through the guide left so few pixels around the holes that there was no class at all."""
    rng = np.random.default_rng(4)
    variance = variance_by_brightness(rng.normal(0.0, 0.1, size=60), np.linspace(0.2, 0.8, 60))
    assert np.ptp(variance) == 0.0
    assert variance[0] == pytest.approx(0.01, rel=0.5)
