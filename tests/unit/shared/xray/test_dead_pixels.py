"""Dead pixels and lines are found and filled in; discs, wires and edges are left as they are."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from shared.xray.dead_pixels import fill_dead_pixels


def image(noise: float = 120.0) -> NDArray[np.float32]:
    """A disc, a wire of two pixels and an edge in noise, blurred as a detector blurs them."""
    pixels = np.full((200, 240), 30_000.0, dtype=np.float32)
    pixels[:, 150:] = 12_000.0
    cv2.circle(pixels, (60, 60), 7, 3_000.0, -1)
    cv2.line(pixels, (20, 150), (120, 190), 8_000.0, 2)
    generator = np.random.default_rng(5)
    return np.asarray(cv2.GaussianBlur(pixels, (0, 0), 1.0) + generator.normal(0.0, noise, pixels.shape), np.float32)


@pytest.mark.parametrize("noise", [0.0, 120.0, 900.0])
def test_a_sound_image_is_left_as_it_is(noise: float) -> None:
    pixels = image(noise)
    filled = fill_dead_pixels(pixels)
    assert not filled.dead.any()
    np.testing.assert_array_equal(filled.pixels, pixels)


def test_black_and_white_pixels_are_filled_in() -> None:
    pixels = image()
    spoiled = pixels.copy()
    places = np.random.default_rng(6).choice(pixels.size, pixels.size // 1000, replace=False)
    spoiled.ravel()[places] = np.where(np.arange(len(places)) % 2, 0.0, 65_535.0)
    filled = fill_dead_pixels(spoiled)
    found = filled.dead.ravel()[places]
    assert found.mean() > 0.9
    assert filled.dead.sum() == found.sum()
    assert np.abs(filled.pixels - pixels)[filled.dead].max() < 2_500.0


@pytest.mark.parametrize("line", [np.s_[75, :], np.s_[:, 100]])
def test_a_dead_line_is_dead_from_end_to_end(line: tuple[slice | int, slice | int]) -> None:
    spoiled = image()
    spoiled[line] = 0.0
    assert fill_dead_pixels(spoiled).dead[line].all()
