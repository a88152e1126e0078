import cv2
import numpy as np
import pytest

from shared.xray.measurement import MeasurementSettings, measure_balls
from tests.unit.shared.xray.discs_image import grid_of_centres, image_of_discs


@pytest.mark.parametrize("seed", [1, 2])
def test_isolated_balls_are_placed_to_five_hundredths_and_the_error_is_foretold(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = grid_of_centres(rng)
    radius = rng.choice([4.36, 7.1], len(truth))
    pixels = image_of_discs(truth, radius, noise=0.006, seed=seed)
    measured = measure_balls(pixels, truth + rng.normal(0.0, 0.6, truth.shape), 0.9 * radius)
    assert measured.seen.all()
    assert measured.overlapped.sum() <= 1  # an edge right under a ball may look like another one
    error = measured.centre_px - truth
    assert np.sqrt(np.mean(error**2)) < 0.05
    normalised = error / measured.standard_deviation_px[:, None]
    assert 0.7 < np.sqrt(np.mean(normalised**2)) < 1.7  # an edge runs through the background


@pytest.mark.parametrize("seed", [3, 4])
def test_overlapping_pairs_are_measured_together(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first = grid_of_centres(rng, spacing_px=50)
    angle = rng.uniform(0.0, 2.0 * np.pi, len(first))
    second = first + 9.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    truth = np.concatenate([first, second])
    radius = np.concatenate([np.full(len(first), 7.0), np.full(len(second), 4.36)])
    pixels = image_of_discs(truth, radius, noise=0.006, seed=seed)
    start = truth + rng.normal(0.0, 0.4, truth.shape)
    measured = measure_balls(pixels, start, 0.93 * radius)
    error = np.hypot(*(measured.centre_px - truth).T)[measured.seen]
    assert measured.overlapped.all()
    assert measured.seen.mean() > 0.97
    assert np.sqrt(np.mean(error**2 / 2.0)) < 0.1
    neighbours = measure_balls(
        pixels, start[: len(first)], 0.93 * radius[: len(first)], start[len(first) :], radius[-1:] * np.ones(len(first))
    )
    alone = measure_balls(pixels, start[: len(first)], 0.93 * radius[: len(first)])
    with_error = np.hypot(*(neighbours.centre_px - first).T)
    alone_error = np.hypot(*(alone.centre_px - first).T)
    # Of the median: the few balls beside the edge are as badly off with their neighbours as without.
    assert np.median(with_error) < 0.5 * np.median(alone_error)


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_a_ball_that_nobody_announced_is_found_beside_the_one_it_covers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = grid_of_centres(rng, spacing_px=50)
    angle = rng.uniform(0.0, 2.0 * np.pi, len(truth))
    place = truth + 7.5 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    covered = np.arange(len(truth)) % 3 == 0
    both = np.concatenate([truth, place[covered]])
    pixels = image_of_discs(both, np.full(len(both), 6.5), noise=0.03, seed=seed)
    start = truth + rng.normal(0.0, 0.15, truth.shape)
    look = MeasurementSettings(reach_px=5.0, drift_px=0.6)
    measured = measure_balls(pixels, start, np.full(len(truth), 6.0), settings=look)
    error = np.hypot(*(measured.centre_px - truth).T)
    assert measured.seen.all()
    assert measured.overlapped[covered].all()
    assert not measured.overlapped[~covered].any()
    assert np.median(error[covered]) < 0.15
    assert error.max() < 0.5


def test_a_slope_of_the_background_draws_no_ball_aside() -> None:
    rng = np.random.default_rng(14)
    truth = grid_of_centres(rng)
    slope = 1.0 + 0.5 * np.sin(np.arange(400) / 15.0)  # a tenth brighter across a ball
    pixels = image_of_discs(truth, np.full(len(truth), 5.0), noise=0.002, seed=14) * slope.astype(np.float32)
    measured = measure_balls(pixels, truth, np.full(len(truth), 4.7), settings=MeasurementSettings(drift_px=0.4))
    steep = np.abs(np.cos(truth[:, 0] / 15.0)) > 0.7
    aside = (measured.centre_px - truth)[:, 0] * np.sign(np.cos(truth[:, 0] / 15.0))
    assert abs(float(np.median(aside[steep & measured.seen]))) < 0.02


def test_a_bright_edge_beside_a_ball_is_no_ball() -> None:
    truth = np.array([[100.0, 100.0]])
    pixels = image_of_discs(truth, np.array([6.0]), noise=0.004, seed=11)
    pixels[:, 110:] *= np.float32(0.7)
    measured = measure_balls(pixels, truth + 0.3, np.array([5.6]))
    assert measured.seen[0]
    assert np.hypot(*(measured.centre_px[0] - truth[0])) < 0.25


@pytest.mark.parametrize(("blur", "least", "most"), [(0.0, 1.0, 1.15), (0.7, 1.8, 3.0), (1.0, 2.3, 4.0)])
def test_correlated_noise_widens_what_is_foretold(blur: float, least: float, most: float) -> None:
    rng = np.random.default_rng(12)
    truth = grid_of_centres(rng, spacing_px=30)
    clean = image_of_discs(truth, np.full(len(truth), 5.0), noise=0.0, seed=12)
    noise = rng.normal(size=clean.shape)
    noise = np.asarray(cv2.GaussianBlur(noise, (0, 0), blur), dtype=np.float64) if blur else noise
    pixels = (clean + 25.0 * noise / noise.std()).astype(np.float32)
    measured = measure_balls(pixels, truth, np.full(len(truth), 4.7))
    assert least <= measured.noise_factor < most


def test_a_ball_that_is_not_there_is_not_seen() -> None:
    truth = np.array([[100.0, 100.0], [200.0, 120.0]])
    pixels = image_of_discs(truth[:1], np.array([6.0]), noise=0.006, seed=8)
    measured = measure_balls(pixels, truth, np.array([6.0, 6.0]))
    assert measured.seen.tolist() == [True, False]


def test_a_ball_cut_by_the_rim_is_not_seen() -> None:
    truth = np.array([[100.0, 100.0]])
    pixels = image_of_discs(truth, np.array([6.0]), noise=0.006, seed=9)
    usable = np.ones(pixels.shape, bool)
    usable[:, :97] = False
    assert not measure_balls(pixels, truth, np.array([6.0]), usable=usable).seen[0]


def test_a_neighbour_on_the_ball_itself_is_taken_for_the_ball() -> None:
    truth = np.array([[150.0, 150.0]])
    pixels = image_of_discs(truth, np.array([6.0]), noise=0.004, seed=10)
    measured = measure_balls(pixels, truth, np.array([6.0]), truth + 0.8, np.array([6.0]))
    assert measured.seen[0]
    assert not measured.overlapped[0]
    assert np.hypot(*(measured.centre_px[0] - truth[0])) < 0.1


def test_nothing_asked_nothing_answered() -> None:
    pixels = np.ones((50, 50), np.float32)
    assert measure_balls(pixels, np.zeros((0, 2)), np.zeros(0)).seen.shape == (0,)
