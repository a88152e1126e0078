import numpy as np
import pytest

from shared.xray.disc_samples import gather, normalise

NOTHING = np.zeros((0, 3))


def test_samples_are_the_usable_pixels_near_a_disc_and_outside_what_is_avoided() -> None:
    pixels = np.arange(400, dtype=np.float32).reshape(20, 20)
    usable = np.ones(pixels.shape, bool)
    usable[:, 12] = False
    samples = gather(pixels, usable, np.array([[10.0, 9.0]]), np.array([4.0]), np.array([[7.0, 9.0, 1.0]]))
    y, x = np.mgrid[:20, :20]
    wanted = (np.hypot(x - 10, y - 9) <= 4.0) & usable & (np.hypot(x - 7, y - 9) > 1.0)
    assert len(samples) == np.count_nonzero(wanted)
    assert set(samples[:, 2]) == set(pixels[wanted])
    assert (samples[:, 2] == 20 * samples[:, 1] + samples[:, 0]).all()


@pytest.mark.parametrize("centre", [(-30.0, 5.0), (5.0, 200.0)])
def test_a_disc_outside_the_image_has_no_samples(centre: tuple[float, float]) -> None:
    pixels, usable = np.ones((20, 20), np.float32), np.ones((20, 20), bool)
    assert len(gather(pixels, usable, np.array([centre]), np.array([4.0]), NOTHING)) == 0


def test_at_the_corner_only_what_is_there_is_taken() -> None:
    pixels, usable = np.ones((20, 20), np.float32), np.ones((20, 20), bool)
    assert len(gather(pixels, usable, np.array([[0.0, 0.0]]), np.array([2.0]), NOTHING)) == 6


def test_normalised_samples_have_mean_zero_and_deviation_one() -> None:
    samples = np.column_stack([np.arange(11.0), 5.0 + np.zeros(11), 100.0 + 7.0 * np.arange(11.0)])
    before = samples[:, 2].copy()
    frame, bright, spread = normalise(samples)
    assert samples[:, 2].mean() == pytest.approx(0.0)
    assert samples[:, 2].std() == pytest.approx(1.0)
    assert spread == pytest.approx(before.std())
    assert bright == pytest.approx(samples[6:, 2].mean())
    assert frame == pytest.approx([5.0, 5.0, 5.0])


def test_a_flat_patch_stays_flat() -> None:
    samples = np.column_stack([np.arange(9.0), np.arange(9.0), np.full(9, 3.0)])
    _, bright, spread = normalise(samples)
    assert (bright, spread) == (0.0, 1.0)
    assert (samples[:, 2] == 0.0).all()
