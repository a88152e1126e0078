"""The intensifier's distortion: invertible, as large as asked, and outside the polynomials."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from simulation.render.distortion import ideal_from_measured, measured_from_ideal
from simulation.scenario.files import merged_ranges
from simulation.scenario.imaging_sampling import sample_c_arm_body, sample_detector
from simulation.scenario.imaging_values import FlatPanel, Intensifier

SIZE, PIXEL_MM = 1024, 0.235


def intensifier(seed: int) -> Intensifier:
    ranges = merged_ranges({"detector": {"flat_panel_probability": 0.0}})
    generator = np.random.default_rng(seed)
    found = sample_detector(ranges, sample_c_arm_body(ranges.c_arm, generator), generator)
    assert isinstance(found, Intensifier)
    return found


def grid() -> NDArray[np.float64]:
    line = np.linspace(60.0, SIZE - 60.0, 41)
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    inside = np.linalg.norm(points - 511.5, axis=1) < 480.0
    return np.asarray(points[inside])


@pytest.mark.parametrize("seed", range(4))
def test_there_and_back(seed: int) -> None:
    print(f"seed {seed}")
    detector, points = intensifier(seed), grid()
    ideal = ideal_from_measured(detector, points, SIZE, PIXEL_MM, 10.0)
    np.testing.assert_allclose(measured_from_ideal(detector, ideal, SIZE, PIXEL_MM, 10.0), points, atol=1e-6)


def test_a_flat_panel_distorts_nothing() -> None:
    np.testing.assert_array_equal(ideal_from_measured(FlatPanel(), grid(), SIZE, PIXEL_MM, 0.0), grid())


def test_pincushion_stretches_the_rim_by_the_share_asked_for() -> None:
    plain = replace(intensifier(0), swirl_rad=0.0, turn_with_angle=0.0, ripple_px=0.0, shift_px=(0.0, 0.0))
    rim = np.array([[511.5 + plain.aperture_radius_px, 511.5]])
    ideal = ideal_from_measured(plain, rim, SIZE, plain.input_radius_mm / 1000.0, 0.0)
    sphere_px = 1000.0
    assert ideal[0, 0] - 511.5 == pytest.approx(sphere_px * np.arctan(plain.aperture_radius_px / sphere_px))


def test_it_changes_with_the_c_arms_angle() -> None:
    detector = replace(intensifier(0), turn_with_angle=1e-4)
    before, after = (ideal_from_measured(detector, grid(), SIZE, PIXEL_MM, a) for a in (0.0, 90.0))
    assert 0.5 < np.abs(after - before).max() < 10.0


@pytest.mark.parametrize("seed", range(3))
def test_no_polynomial_of_fifth_order_fits_exactly(seed: int) -> None:
    print(f"seed {seed}")
    points = grid()
    shift = ideal_from_measured(intensifier(seed), points, SIZE, PIXEL_MM, 0.0) - points
    x, y = ((points - 511.5) / 512.0).T
    basis = np.stack([x**i * y**j for i in range(6) for j in range(6 - i)], axis=1)
    left = shift - basis @ np.linalg.lstsq(basis, shift, rcond=None)[0]
    rms = np.sqrt(np.mean(np.sum(left**2, axis=1)))
    assert 0.03 < rms < 0.6
    assert 10.0 < np.linalg.norm(shift, axis=1).max() < 60.0
