"""The display: monotone curve, turned and mirrored pixels that agree with turned points."""

from dataclasses import replace

import numpy as np
import pytest

from simulation.render.display import as_shown, curve, grey_values, turned_from_detector, turned_points
from tests.unit.simulation.rooms import PLAIN_DISPLAY


@pytest.mark.parametrize(("toe", "shoulder"), [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (0.3, 0.2)])
def test_the_curve_is_monotone_from_black_to_white(toe: float, shoulder: float) -> None:
    display = replace(PLAIN_DISPLAY, gamma=0.6, toe=toe, shoulder=shoulder)
    shown = curve(display, np.linspace(0.0, 1.0, 1001, dtype=np.float32))
    assert np.all(np.diff(shown) >= -1e-7)
    assert shown[0] == 0.0
    assert shown[-1] == pytest.approx(1.0)


@pytest.mark.parametrize("quarter_turns", range(4))
def test_turned_points_find_their_pixels(quarter_turns: int) -> None:
    image = np.arange(49, dtype=np.uint16).reshape(7, 7)
    display = replace(PLAIN_DISPLAY, quarter_turns=quarter_turns)
    column, row = turned_points(display, np.array([5.0, 1.0]), 7).astype(int)
    assert as_shown(display, image)[row, column] == image[1, 5]


@pytest.mark.parametrize("quarter_turns", range(4))
def test_turned_axes_agree_with_turned_points(quarter_turns: int) -> None:
    display = replace(PLAIN_DISPLAY, quarter_turns=quarter_turns)
    start, end = turned_points(display, np.array([[3.0, 3.0], [5.0, 2.0]]), 7)
    np.testing.assert_allclose(end - start, (turned_from_detector(display) @ [2.0, -1.0, 0.0])[:2], atol=1e-12)
    assert np.linalg.det(turned_from_detector(display)) == pytest.approx(1.0)


def test_mirroring_comes_after_turning() -> None:
    image = np.arange(49, dtype=np.uint16).reshape(7, 7)
    display = replace(PLAIN_DISPLAY, quarter_turns=1, mirrored=True)
    column, row = turned_points(display, np.array([5.0, 1.0]), 7).astype(int)
    assert as_shown(display, image)[row, 6 - column] == image[1, 5]


@pytest.mark.parametrize(("bits", "step", "most"), [(8, 1, 255), (12, 16, 65520), (16, 1, 65535)])
def test_bits_fill_their_container_from_above(bits: int, step: int, most: int) -> None:
    display = replace(PLAIN_DISPLAY, bits=bits, white_percentile=50.0, white_level=1.0)
    signal = np.linspace(0.0, 2.0, 10000, dtype=np.float32).reshape(100, 100)
    grey = grey_values(display, signal, np.ones_like(signal))
    assert grey.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert grey.max() == most
    assert np.all(grey % step == 0)


def test_outside_the_window_is_black() -> None:
    signal = np.ones((50, 50), np.float32)
    window = np.ones_like(signal)
    window[:, :10] = 0.0
    assert np.all(grey_values(PLAIN_DISPLAY, signal, window)[:, :10] == 0)


def test_sharpening_overshoots_at_an_edge() -> None:
    signal = np.full((60, 60), 0.4, np.float32)
    signal[:, 30:] = 0.2
    plain = grey_values(PLAIN_DISPLAY, signal, np.ones_like(signal))
    sharp = grey_values(replace(PLAIN_DISPLAY, sharpening=0.6), signal, np.ones_like(signal))
    assert sharp[30, 30] < plain[30, 30]
    assert sharp[30, 29] > plain[30, 29]
    assert sharp[30, 55] == plain[30, 55]
