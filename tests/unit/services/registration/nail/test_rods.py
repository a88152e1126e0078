"""Steel rods: their shadow's length along rays, against geometry that can be done by hand."""

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.nail.rods import SteelRod, add_rod_path
from tests.unit.services.registration.xray_scene import FOCAL_PX, calibration

ACROSS = SteelRod(np.array([-20.0, 0.0, 700.0]), np.array([30.0, 0.0, 700.0]), 2.0)
ALONG = SteelRod(np.array([0.0, 0.0, 600.0]), np.array([0.0, 0.0, 640.0]), 2.0)


def path_mm(rod: SteelRod, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Through points of the camera's frame, shape (N, 3)."""
    out = np.zeros(len(points))
    add_rod_path(np.ascontiguousarray(points[:, :2] / points[:, 2:]), rod, out)
    return out


def test_a_rod_across_the_beam_is_as_long_as_its_chord() -> None:
    off_axis_mm = np.array([0.0, 0.5, 0.9, 1.1])
    points = np.column_stack([np.zeros(4), off_axis_mm, np.full(4, 700.0)])
    expected = 2.0 * np.sqrt(np.maximum(1.0 - off_axis_mm**2, 0.0))
    assert path_mm(ACROSS, points) == pytest.approx(expected, abs=2e-3)


def test_it_ends_where_it_ends() -> None:
    x = np.array([-20.2, -19.8, 29.8, 30.2])
    points = np.column_stack([x, np.zeros(4), np.full(4, 700.0)])
    assert (path_mm(ACROSS, points) > 1.0).tolist() == [False, True, True, False]


def test_a_rod_along_the_beam_is_as_long_as_it_is() -> None:
    points = np.array([[0.0, 0.0, 620.0], [0.9, 0.0, 640.0], [1.1, 0.0, 600.0]])
    assert path_mm(ALONG, points) == pytest.approx([40.0, 40.0, 0.0], abs=2e-4)


def test_paths_of_several_rods_add_up() -> None:
    out = np.zeros(1)
    for rod in (ACROSS, ALONG):
        add_rod_path(np.zeros((1, 2)), rod, out)
    assert out == pytest.approx([42.0])


def test_its_discs_cover_its_image() -> None:
    discs = ACROSS.discs_px(calibration(640), wider_mm=0.5)
    middle = 0.5 * (640 - 1)
    assert discs[[0, -1], 0] - middle == pytest.approx(np.array([-20.0, 30.0]) * FOCAL_PX / 700.0)
    assert discs[:, 2] == pytest.approx(1.5 * FOCAL_PX / 700.0)
