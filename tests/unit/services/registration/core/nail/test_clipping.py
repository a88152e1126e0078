"""Clipped pixels are those that are cut off, and those so near that their noise is; others are kept."""

import numpy as np

from services.registration.core.nail.clipping import clipped_pixels

NOISE = 2.0


def ramp() -> np.ndarray:
    """Grey values that rise by one noise deviation every ten columns, from far below the cut at 100."""
    level = 80.0 + NOISE * np.arange(200) / 10.0
    return np.asarray(level + np.random.default_rng(3).normal(0.0, NOISE, (60, 200)), dtype=np.float32)


def test_an_image_that_is_not_cut_off_loses_nothing() -> None:
    assert not clipped_pixels(ramp()).any()


def test_pixels_are_left_out_up_to_where_noise_is_hardly_cut_off() -> None:
    clipped = clipped_pixels(np.maximum(ramp(), 100.0).astype(np.float32))
    share = clipped[5:-5].mean(axis=0)
    assert share[:100].min() == 1.0, "at the cut and below"
    assert share[105:112].min() > 0.9, "one noise deviation above it"
    assert share[135:].max() < 0.05, "beyond three"
