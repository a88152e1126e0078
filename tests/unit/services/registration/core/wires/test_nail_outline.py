"""Points of the nail's outline count by degrees, whatever falls on which side of a pixel's border."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.wires.nail_outline import NailOutline, NailOutlineMatch, SmoothImage, match_nail_outline
from tests.unit.services.registration.core.wires.test_joint_estimate import blank_view

EDGE_PX, ROWS, COLUMNS = 50.3, 200, 100


def bright_right_of_an_edge(step: NDArray[np.float64]) -> NDArray[np.float32]:
    """A vertical edge, each row with its own step, as soft as images are made before they are matched."""
    right = np.clip(np.arange(COLUMNS) - EDGE_PX + 0.5, 0.0, 1.0)
    return np.asarray(cv2.GaussianBlur(np.outer(step, right).astype(np.float32), (0, 0), 1.0), dtype=np.float32)


def matched(step: NDArray[np.float64], free: NDArray[np.float32], rows_px: NDArray[np.float64]) -> NailOutlineMatch:
    """Points on column 50 of some rows, the nail to their left."""
    points = np.column_stack([np.full(len(rows_px), 50.0), rows_px])
    side = np.zeros(len(rows_px), dtype=np.int64)
    outline = NailOutline(points, np.tile([1.0, 0.0], (len(rows_px), 1)), np.zeros((len(rows_px), 3)), side)
    return match_nail_outline(SmoothImage(blank_view(), bright_right_of_an_edge(step), free), outline, 3.0)


ALL_FREE = np.ones((ROWS, COLUMNS), dtype=np.float32)
INNER_ROWS = np.arange(20.0, 180.0)


def test_an_edge_is_found_to_a_fraction_of_a_pixel_and_counts_whole() -> None:
    found = matched(np.ones(ROWS), ALL_FREE, INNER_ROWS)
    assert found.found_fraction == 1.0
    assert found.weight == pytest.approx(np.ones(len(INNER_ROWS)))
    assert found.residual_px == pytest.approx(np.full(len(INNER_ROWS), EDGE_PX - 50.0), abs=0.05)


@pytest.mark.parametrize(("of_usual", "counts"), [(0.25, 0.0), (0.35, 0.5), (0.375, 0.75), (0.45, 1.0)])
def test_a_step_smaller_than_usual_counts_in_part(of_usual: float, counts: float) -> None:
    step = np.ones(ROWS)
    step[90:110] = of_usual
    found = matched(step, ALL_FREE, INNER_ROWS)
    inner = np.isin(found.index, np.flatnonzero((INNER_ROWS > 95.0) & (INNER_ROWS < 104.0)))
    assert found.weight[inner].sum() == pytest.approx(8.0 * counts, abs=0.05)
    assert found.found_fraction == pytest.approx(1.0 - 20.0 / 160.0 * (1.0 - counts), abs=0.02)


def test_points_that_slide_under_a_cover_fade() -> None:
    free = ALL_FREE.copy()
    free[100:] = 0.0
    sums = [matched(np.ones(ROWS), free, INNER_ROWS + slid).weight.sum() for slid in np.arange(0.0, 1.01, 0.1)]
    assert sums[0] - sums[-1] == pytest.approx(1.0)
    assert (np.abs(np.diff(sums)) < 0.3).all()
