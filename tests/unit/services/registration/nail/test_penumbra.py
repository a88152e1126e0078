"""Edges beside the nail are as soft as a focal spot makes them."""

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.nail.penumbra import Penumbra
from shared.geometry.calibration import CArmCalibration
from tests.unit.services.registration.xray_scene import FOCAL_PX, RING_DEPTH_MM, calibration

NAIL_MM, SPOT_MM = 720.0, 0.5
PX_PER_MM = FOCAL_PX / RING_DEPTH_MM


def view() -> CArmCalibration:
    return calibration(512)


def places_of_an_edge_px(depth_mm: float) -> NDArray[np.float64]:
    """Where rays that pass one point of a depth meet the detector, from all over the spot and to all of a pixel."""
    evenly = (np.arange(40) + 0.5) / 40 - 0.5
    places = []
    for in_pixel, on_spot in product(evenly, evenly):
        slope = (0.0 - on_spot * SPOT_MM) / depth_mm
        places.append(in_pixel + PX_PER_MM * (on_spot * SPOT_MM + slope * RING_DEPTH_MM))
    return np.array(places)


@pytest.mark.parametrize("depth_mm", [600.0, 660.0, NAIL_MM, 780.0])
def test_places_and_the_nails_blur_spread_an_edge_as_the_focal_spot_does(depth_mm: float) -> None:
    spread = float(Penumbra.beside(view(), NAIL_MM, 1.0).spread(np.array(depth_mm)))
    by_places = spread**2 / 12.0
    by_nails_blur = float(np.var(places_of_an_edge_px(NAIL_MM))) - 1.0 / 12.0
    assert by_places + by_nails_blur == pytest.approx(float(np.var(places_of_an_edge_px(depth_mm))), rel=0.01)


def test_what_lies_at_the_nails_depth_is_as_soft_as_the_nail() -> None:
    assert Penumbra.beside(view(), NAIL_MM, 1.0).spread(np.array([NAIL_MM])) == pytest.approx([1.0])


def test_the_rings_balls_are_sharper_but_never_sharper_than_a_point() -> None:
    at_detector = np.array([RING_DEPTH_MM, RING_DEPTH_MM + 10.0])
    taken_away = float(np.var(places_of_an_edge_px(NAIL_MM))) - 1.0 / 12.0
    spread = Penumbra.beside(view(), NAIL_MM, 1.0).spread(at_detector)
    assert spread == pytest.approx(np.sqrt(1.0 - 12.0 * taken_away), rel=0.01)
    assert (spread < 0.75).all()
    assert (Penumbra.beside(view(), 300.0, 1.0).spread(at_detector) > 0.0).all()


def test_large_pixels_hide_penumbras() -> None:
    depth = np.array([600.0])
    assert (
        1.0 < Penumbra.beside(view(), NAIL_MM, 3.0).spread(depth) < Penumbra.beside(view(), NAIL_MM, 1.0).spread(depth)
    )
