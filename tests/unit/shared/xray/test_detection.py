import numpy as np
import pytest
from numpy.typing import NDArray

from shared.xray.detection import detect_balls
from tests.unit.shared.xray.discs_image import grid_of_centres, image_of_discs

RANGE_PX = (3.5, 8.5)


def _nearest(found: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.hypot(*(truth[:, None] - found[None]).transpose(2, 0, 1)).min(axis=1))


@pytest.mark.parametrize("seed", [1, 2])
def test_every_ball_is_found_and_placed_to_a_tenth_of_a_pixel(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = grid_of_centres(rng)
    radius = rng.choice([4.36, 7.1], len(truth))
    pixels = image_of_discs(truth, radius, noise=0.006, seed=seed)
    found = detect_balls(pixels, np.ones(pixels.shape, bool), RANGE_PX)
    error = _nearest(found.centre_px, truth)
    assert error.max() < 1.0
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert len(found.radius_px) <= 1.3 * len(truth)
    assert (found.contrast > 0).all()
    assert (found.ring_index == -1).all()


def test_a_monotone_stretch_of_grey_values_changes_little() -> None:
    rng = np.random.default_rng(5)
    truth = grid_of_centres(rng)
    pixels = image_of_discs(truth, np.full(len(truth), 5.5), noise=0.004, seed=5)
    stretched = (3.0 * np.sqrt(pixels + 20.0) + 7.0).astype(np.float32)
    usable = np.ones(pixels.shape, bool)
    plain = detect_balls(pixels, usable, RANGE_PX)
    other = detect_balls(stretched, usable, RANGE_PX)
    assert _nearest(plain.centre_px, truth).max() < 0.5
    assert _nearest(other.centre_px, truth).max() < 0.5


def test_bright_discs_are_not_balls() -> None:
    truth = grid_of_centres(np.random.default_rng(6))
    pixels = image_of_discs(truth, np.full(len(truth), 5.5), noise=0.004, seed=6)
    found = detect_balls(np.asarray(1000.0 - pixels, np.float32), np.ones(pixels.shape, bool), RANGE_PX)
    close = _nearest(found.centre_px, truth) < 2.0 if len(found.radius_px) else np.zeros(len(truth), bool)
    assert close.mean() < 0.1


def test_nothing_is_found_outside_the_usable_area_nor_at_its_rim() -> None:
    pixels = image_of_discs(np.array([[200.0, 200.0]]), np.array([6.0]), noise=0.004, seed=7)
    y, x = np.mgrid[0:400, 0:400]
    usable = np.hypot(x - 200, y - 200) < 150
    pixels[~usable] = 0.0
    found = detect_balls(pixels, usable, RANGE_PX)
    assert len(found.radius_px) >= 1
    assert np.hypot(*(found.centre_px[0] - 200.0)) < 0.2
    assert (np.hypot(*(found.centre_px - 200.0).T) < 150).all()
    assert len(found.radius_px) < 10


def test_an_image_without_contrast_has_no_balls() -> None:
    empty = np.full((300, 300), 7.0, np.float32)
    assert len(detect_balls(empty, np.ones(empty.shape, bool), RANGE_PX).radius_px) == 0
