"""The paper's calibration: the polynomial from the near plate, the source from the far one."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from baselines.fronto_parallel.calibration import calibrate_by_plates
from baselines.fronto_parallel.dewarping import fit_dewarping, on_grid
from shared.errors import Accepted, ReasonCode, Rejected
from shared.geometry.calibration import BallCandidates, CArmCalibration
from shared.geometry.parts import BallPattern, RingPart
from tests.unit.services.registration.xray_scene import FOCAL_PX, RING_DEPTH_MM, Scene, calibration, pincushion, render

SIZE_PX = 640
SOURCE_MM = np.array([0.0, 0.0, -RING_DEPTH_MM])


def ring_part() -> RingPart:
    """Two plates with 32 balls each, 76 mm apart, whose shadows do not touch."""
    rng = np.random.default_rng(4)
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-58.0, 58.0, 8), np.linspace(-58.0, 58.0, 8)))
    height = np.where((np.arange(64) + np.arange(64) // 8) % 2, -76.0, 0.0)
    shadow = np.column_stack([x, y]) + rng.uniform(-2.0, 2.0, (64, 2))
    place = shadow * ((RING_DEPTH_MM + height) / RING_DEPTH_MM)[:, None]
    pattern = BallPattern(tuple(f"R{k}" for k in range(64)), np.column_stack([place, height]), np.full(64, 2.0))
    return RingPart(pattern, (), "0" * 64)


def seen(named: slice = slice(None)) -> tuple[NDArray[np.float32], CArmCalibration, RingPart]:
    """A distorted image of the ring, and a calibration that has the names right and the rest wrong."""
    ring, view = ring_part(), calibration(SIZE_PX, pincushion(SIZE_PX, 0.05))
    centres = view.camera_from_ring @ ring.balls.position_mm
    pixels = render(Scene(SIZE_PX, balls=np.column_stack([centres, ring.balls.diameter_mm])), view, seed=8)
    index = np.arange(64, dtype=np.int64)[named]
    at_px = view.image_from_camera(centres)[named] + 0.5
    radius = FOCAL_PX / centres[named, 2]
    balls = BallCandidates(at_px, radius, np.ones(len(index)), np.full(len(index), 0.5), index)
    return pixels, replace(calibration(SIZE_PX), balls=balls), ring


def test_source_and_distortion_are_recovered() -> None:
    pixels, named, ring = seen()
    result = calibrate_by_plates(pixels, named, ring)
    assert isinstance(result, Accepted), result
    found = result.value
    assert found.balls_found >= 58
    source = found.camera_from_ring.inverse().translation_mm
    deviation = np.sqrt(np.diag(found.source_covariance_mm2))
    assert source == pytest.approx(SOURCE_MM, abs=12.0)
    assert (np.abs(source - SOURCE_MM) < 5.0 * deviation).all()
    true = calibration(SIZE_PX, pincushion(SIZE_PX, 0.05))
    near = true.camera_from_ring @ np.array([[x, y, 0.0] for x in (-40.0, 0.0, 40.0) for y in (-40.0, 0.0, 40.0)])
    measured = true.image_from_camera(near)
    again = found.image_from_camera(found.camera_from_ring @ (true.camera_from_ring.inverse() @ near))
    assert again == pytest.approx(measured, abs=0.4)


def test_a_mirrored_display_is_undone_first() -> None:
    pixels, named, ring = seen()
    straight = calibrate_by_plates(pixels, named, ring)
    mirrored = calibrate_by_plates(np.ascontiguousarray(pixels[:, ::-1]), replace(named, mirrored=True), ring)
    assert isinstance(straight, Accepted)
    assert isinstance(mirrored, Accepted)
    assert mirrored.value.camera_from_ring.matrix == pytest.approx(straight.value.camera_from_ring.matrix)


def test_too_few_balls_are_refused() -> None:
    pixels, named, ring = seen(slice(0, 20))
    result = calibrate_by_plates(pixels, named, ring)
    assert isinstance(result, Rejected)
    assert result.reasons[0].code is ReasonCode.RING_TOO_FEW_BALLS
    assert "limit 12" in result.reasons[0].message


def test_the_polynomial_is_of_the_order_that_predicts_best() -> None:
    rng = np.random.default_rng(6)
    measured = rng.uniform(0.0, 800.0, (70, 2))
    x, y = (measured.T - 400.0) / 400.0
    cubic = measured + np.stack([9.0 * x**3 - 4.0 * x * y**2, 7.0 * y**3 + 3.0 * x**2 * y], axis=-1)
    fit = fit_dewarping(measured, cubic + 0.02 * rng.standard_normal((70, 2)))
    assert fit.order == 3
    assert fit.left_out_rms_px == pytest.approx(0.02, rel=0.3)
    elsewhere = np.array([[100.0, 150.0], [700.0, 300.0]])
    field = on_grid(fit, 800, 800, None)
    assert field.undistort(elsewhere) == pytest.approx(fit.ideal_px(elsewhere), abs=0.02)
    assert (field.standard_deviation_at(elsewhere) < 0.02).all()
