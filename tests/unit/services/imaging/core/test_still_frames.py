from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from services.imaging.core.still_frames import MotionLimits, last_still_run, moved_part, still_runs

Array = NDArray[np.float32]
LIMITS = MotionLimits(most_frames=8)


def scene(shift_px: float, gain: float = 1.0) -> NDArray[np.float64]:
    """Thirty balls and the edge of a leg, moved sideways."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[:256, :256]
    light = 900.0 - 400.0 / (1.0 + np.exp((np.abs(x - shift_px - 128.0) - 50.0) / 1.5))
    for px, py in rng.uniform(20.0, 236.0, (30, 2)):
        light *= 1.0 - 0.8 / (1.0 + np.exp((np.hypot(x - shift_px - px, y - py) - 5.0) / 0.8))
    return np.asarray(gain * light)


def frame(shift_px: float, rng: np.random.Generator, gain: float = 1.0, blur: float = 0.0) -> Array:
    noise = rng.normal(0.0, 1.0, (256, 256))
    noise = np.asarray(cv2.GaussianBlur(noise, (0, 0), blur), np.float64) if blur else noise
    return np.asarray(scene(shift_px, gain) + 18.0 * noise / noise.std(), dtype=np.float32)


@pytest.mark.parametrize("blur", [0.0, 0.9])
@pytest.mark.parametrize("gain", [1.0, 1.15])
def test_noise_and_exposure_are_no_motion(gain: float, blur: float) -> None:
    rng = np.random.default_rng(1)
    reference = np.mean([frame(0.0, rng, blur=blur) for _ in range(4)], axis=0).astype(np.float32)
    assert moved_part(frame(0.0, rng, gain, blur), reference) < LIMITS.moved_blocks


@pytest.mark.parametrize("shift", [0.7, 2.0, 15.0])
def test_a_shift_is_motion(shift: float) -> None:
    rng = np.random.default_rng(2)
    assert moved_part(frame(shift, rng), frame(0.0, rng)) > LIMITS.moved_blocks


def test_a_clock_in_the_corner_is_no_motion() -> None:
    rng = np.random.default_rng(3)
    first, second = frame(0.0, rng), frame(0.0, rng)
    second[4:12, 4:12] = 4000.0
    assert moved_part(second, first) <= LIMITS.moved_blocks


def frames(*shifts: float) -> Iterator[Array]:
    rng = np.random.default_rng(4)
    return (frame(s, rng) for s in shifts)


def test_pieces_are_cut_where_something_moves() -> None:
    runs = list(still_runs(frames(0, 0, 0, 0, 3, 6, 9, 9, 9), LIMITS))
    assert [r.frames for r in runs] == [4, 1, 1, 3]
    assert np.abs(runs[0].mean - scene(0.0)).mean() < 0.6 * 18.0 * 0.8


def test_a_long_still_view_gives_one_piece() -> None:
    assert [r.frames for r in still_runs(frames(*[0.0] * 20, *[5.0] * 3), LIMITS)] == [8, 3]


def test_the_piece_at_the_end_is_chosen() -> None:
    last = last_still_run(frames(*[0.0] * 6, 4, *[8.0] * 3))
    assert last is not None
    assert last.frames == 3
    assert np.abs(last.mean - scene(8.0)).mean() < np.abs(last.mean - scene(0.0)).mean() / 4.0
    assert last_still_run(iter(())) is None


def test_a_short_end_is_not_replaced_by_a_longer_piece_before_it() -> None:
    last = last_still_run(frames(*[0.0] * 6, 4))
    assert last is not None
    assert last.frames == 1


def test_a_long_end_is_averaged_whole() -> None:
    last = last_still_run(frames(*[0.0] * 20), LIMITS)
    assert last is not None
    assert last.frames == 20


def test_frames_of_another_size_are_another_view() -> None:
    sizes = [np.ones((64, 64), np.float32), np.ones((64, 80), np.float32)]
    assert [r.frames for r in still_runs(sizes, LIMITS)] == [1, 1]
