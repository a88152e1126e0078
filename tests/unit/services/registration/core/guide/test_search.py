"""Votes for a pair of discs: balls that fall on discs count, balls beside the map do not."""

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.guide.search import vote

_DEPTH_MM = 600.0
# Two balls that are taken for the pair of discs, and one that is looked for.
_PAIR_MM = np.array([[-20.0, 0.0, 0.0], [20.0, 0.0, 0.0]])
_SIDE = 40


def votes(third_mm: tuple[float, float], occupied: NDArray[np.uint8]) -> int:
    """Score when the pair lies on its own discs; the map's cells are 1 mm wide at the guide, its middle is the beam."""
    balls = np.vstack([_PAIR_MM, (*third_mm, 0.0)])[None]
    rays = _PAIR_MM[:, :2] / _DEPTH_MM
    cell_from_slope = np.array([[_DEPTH_MM, 0.0, 0.5 * _SIDE], [0.0, _DEPTH_MM, 0.5 * _SIDE]])
    first, second = np.array([0]), np.array([1])
    return int(vote(balls, first, second, rays, (500.0, 700.0), cell_from_slope, occupied, 3)[0, 0])


@pytest.mark.parametrize("place", [(0.5, 10.5), (-19.5, -19.5), (19.5, 19.5)])
def test_a_ball_on_a_disc_counts(place: tuple[float, float]) -> None:
    occupied = np.zeros((_SIDE, _SIDE), dtype=np.uint8)
    occupied[int(place[1] + 0.5 * _SIDE), int(place[0] + 0.5 * _SIDE)] = 1
    assert votes(place, occupied) == 1
    assert votes(place, np.zeros_like(occupied)) == 0


@pytest.mark.parametrize("place", [(-25.5, 0.0), (25.5, 0.0), (0.0, -25.5), (0.0, 25.5), (-25.5, 25.5)])
def test_a_ball_beside_the_map_does_not_count(place: tuple[float, float]) -> None:
    everywhere = np.ones((_SIDE, _SIDE), dtype=np.uint8)
    assert votes(place, everywhere) == votes((0.0, 0.0), everywhere) - 1
