"""The filter against correlated noise."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from shared.xray.noise_filter import noise_whitened

SIDE = 360
BOX = np.array([[60.0, 60.0], [300.0, 300.0]])
INNER = (slice(80, 280), slice(80, 280))
EVERYWHERE = np.ones((SIDE, SIDE), dtype=bool)


def correlated_noise(seed: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    blurred = gaussian_filter(rng.normal(size=(SIDE, SIDE)), 1.2)
    return np.asarray(blurred / blurred.std() + 0.05 * rng.normal(size=(SIDE, SIDE)))


def correlation_of_neighbours(image: NDArray[np.float32]) -> float:
    return float(np.corrcoef(image[INNER][:, 1:].ravel(), image[INNER][:, :-1].ravel())[0, 1])


def test_neighbouring_pixels_err_less_together() -> None:
    image = correlated_noise(1).astype(np.float32)
    assert correlation_of_neighbours(image) > 0.8
    assert correlation_of_neighbours(noise_whitened(image, EVERYWHERE, BOX, 20.0)) < 0.65


def test_white_noise_stays_as_it_is() -> None:
    image = np.random.default_rng(2).normal(size=(SIDE, SIDE)).astype(np.float32)
    filtered = noise_whitened(image, EVERYWHERE, BOX, 20.0)
    assert np.corrcoef(image[INNER].ravel(), filtered[INNER].ravel())[0, 1] > 0.97


def test_slow_shades_and_everything_outside_the_box_are_kept() -> None:
    y, x = np.mgrid[:SIDE, :SIDE]
    shade = (40.0 * np.sin(x / 40.0) + 0.3 * y).astype(np.float32)
    image = shade + correlated_noise(3).astype(np.float32)
    filtered = noise_whitened(image, EVERYWHERE, BOX, 20.0)
    assert np.array_equal(filtered[:, :39], image[:, :39])
    assert np.array_equal(filtered[321:], image[321:])
    assert np.abs(gaussian_filter((filtered - shade)[INNER], 12.0)).max() < 1.0


@pytest.mark.parametrize("places", [np.array([[100.0, 100.0]]), np.array([[-500.0, -500.0]])])
def test_too_little_image_to_learn_the_noise_from_leaves_it_alone(places: NDArray[np.float64]) -> None:
    image = correlated_noise(4).astype(np.float32)
    assert np.array_equal(noise_whitened(image, EVERYWHERE, places, 30.0), image)


@pytest.mark.parametrize("clipped", [0.5, 0.93, 1.0])
def test_noise_is_not_learned_where_the_display_has_clipped_it(clipped: float) -> None:
    image = correlated_noise(5).astype(np.float32)
    shown = int((1.0 - clipped) * SIDE)
    image[:, shown:] = image.max()
    filtered = noise_whitened(image, EVERYWHERE, BOX, 60.0)
    assert np.isfinite(filtered).all()
    if clipped > 0.9:  # hardly anything to learn from
        assert np.array_equal(filtered, image)
    else:
        part = filtered[80:280, 20 : shown - 20]
        assert np.corrcoef(part[:, 1:].ravel(), part[:, :-1].ravel())[0, 1] < 0.65
