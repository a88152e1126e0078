"""Distortion: there and back, and a whole window at once as pixel by pixel."""

import numpy as np
import pytest

from shared.geometry.camera import DisplacementField

SPACING_PX = 51.2
NODES = (21, 23)


def some_distortion() -> DisplacementField:
    """Up to some ten pixels, smooth over a node or two."""
    rng = np.random.default_rng(5)
    displacement_px = np.cumsum(rng.normal(0.0, 0.5, (*NODES, 2)), axis=0)
    return DisplacementField(np.array([-51.2, -40.0]), SPACING_PX, displacement_px, np.zeros(NODES))


def test_distorting_undoes_undistorting() -> None:
    field = some_distortion()
    measured_px = np.random.default_rng(6).uniform(0.0, 900.0, (50, 2))
    assert np.abs(field.displacement_at(measured_px)).max() > 2.0
    assert field.distort(field.undistort(measured_px)) == pytest.approx(measured_px, abs=1e-7)


def test_a_window_is_undistorted_as_its_pixels_are() -> None:
    """Inside the nodes, between the last two, and beyond them."""
    field = some_distortion()
    x_px, y_px = np.arange(-130.0, 1300.0, 31.0), np.arange(-120.0, 1200.0, 37.0)
    pixels = np.stack(np.meshgrid(x_px, y_px), axis=-1)
    assert field.undistort_grid(x_px, y_px) == pytest.approx(field.undistort(pixels), abs=1e-9)


def test_nodes_keep_their_displacement() -> None:
    field = some_distortion()
    inner = field.origin_px + SPACING_PX * np.array([7.0, 9.0])
    assert field.displacement_at(inner) == pytest.approx(field.displacement_px[9, 7], abs=1e-9)
