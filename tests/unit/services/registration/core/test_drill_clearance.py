"""Does the drill pass? Offsets, bounds and chances against closed forms."""

import numpy as np
import pytest
from scipy.stats import ncx2

from services.registration.core.drill_clearance import AxisOffset, across_basis, angle_deg, axis_offset_mm
from shared.geometry.lines import Line

Z = np.array([0.0, 0.0, 1.0])


def offset(covariance: object, mean: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)) -> AxisOffset:
    return AxisOffset(np.array(mean), np.asarray(covariance, dtype=np.float64), 11.0)


def test_a_pure_shift_passes_as_rayleigh_says() -> None:
    """Entry and exit move together by sigma per axis: P = 1 - exp(-play^2 / 2 sigma^2), play 0.65 mm."""
    shift = 0.3**2 * np.kron(np.ones((2, 2)), np.eye(2))
    assert offset(shift).clearance_probability(5.3, 4.0) == pytest.approx(
        1.0 - np.exp(-0.5 * (0.65 / 0.3) ** 2), abs=0.002
    )


def test_independent_ends_must_both_pass() -> None:
    one_end = 1.0 - np.exp(-0.5 * (0.65 / 0.3) ** 2)
    assert offset(0.09 * np.eye(4)).clearance_probability(5.3, 4.0) == pytest.approx(one_end**2, abs=0.002)


def test_a_bias_counts() -> None:
    shift = 0.1**2 * np.kron(np.ones((2, 2)), np.eye(2))
    expected = ncx2.cdf((0.65 / 0.1) ** 2, 2, (0.5 / 0.1) ** 2)
    assert offset(shift, (0.5, 0.0, 0.5, 0.0)).clearance_probability(5.3, 4.0) == pytest.approx(expected, abs=0.003)


@pytest.mark.parametrize("hole_mm", [4.0, 3.9])
def test_no_play_no_chance(hole_mm: float) -> None:
    assert offset(np.zeros((4, 4))).clearance_probability(hole_mm, 4.0) == 0.0
    assert offset(1e-12 * np.eye(4)).clearance_probability(hole_mm, 4.0) == 0.0


def test_predicted_rms_of_both_errors() -> None:
    """0.03 mm per axis at each end independently: entry 0.042 mm, axis sqrt(2) * 0.042 / 11 rad."""
    made = offset(0.03**2 * np.eye(4))
    assert made.entry_sd_mm == pytest.approx(0.03 * np.sqrt(2.0))
    assert made.axis_sd_deg == pytest.approx(np.degrees(0.03 * 2.0 / 11.0))
    assert made.entry_bound_mm == pytest.approx(0.03 * 2.4477, rel=1e-4)
    assert made.axis_bound_deg == pytest.approx(np.degrees(0.03 * np.sqrt(2.0) / 11.0) * 2.4477, rel=1e-4)


def test_sizes_of_an_offset_at_entry_and_exit() -> None:
    made = offset(np.eye(4), (0.3, -0.4, 1.2, 0.5))
    assert made.entry_mm == pytest.approx(0.5)
    assert made.exit_mm == pytest.approx(1.3)


def test_bounds_follow_the_worst_direction_and_predicted_rms_both() -> None:
    """Variances across: 0.04 and 0.01 mm² at the entry, 0.06 and 0.0025 mm² at the exit, all independent."""
    made = offset(np.diag([0.01, 0.04, 0.0025, 0.06]))
    assert made.entry_sd_mm == pytest.approx(np.sqrt(0.05))
    assert made.entry_bound_mm == pytest.approx(2.4477 * 0.2, rel=1e-4)
    assert made.axis_sd_deg == pytest.approx(np.degrees(np.sqrt(0.1125) / 11.0))
    assert made.axis_bound_deg == pytest.approx(2.4477 * np.degrees(np.sqrt(0.1) / 11.0), rel=1e-4)


@pytest.mark.parametrize("correlation", [-0.98, 0.98])
def test_errors_that_both_ends_share_turn_the_axis_less(correlation: float) -> None:
    made = offset(0.3**2 * np.kron([[1.0, correlation], [correlation, 1.0]], np.eye(2)))
    slope_sd_deg = np.degrees(0.3 * np.sqrt(2.0 - 2.0 * correlation) / 11.0)
    assert made.axis_sd_deg == pytest.approx(np.sqrt(2.0) * slope_sd_deg)
    assert made.axis_bound_deg == pytest.approx(2.4477 * slope_sd_deg, rel=1e-4)


@pytest.mark.parametrize(("off_mm", "chance"), [(0.75, 1.0), (0.7501, 0.0)])
@pytest.mark.parametrize("end", [0, 1, 2, 3])
def test_a_drill_that_touches_the_wall_at_either_end_still_passes(end: int, off_mm: float, chance: float) -> None:
    mean = off_mm * np.eye(4)[end]
    assert offset(np.zeros((4, 4)), tuple(mean)).clearance_probability(5.5, 4.0) == chance


def test_a_covariance_that_rounding_made_slightly_negative_has_a_chance() -> None:
    assert offset(np.diag([0.01, 0.01, 0.01, -1e-18])).clearance_probability(5.5, 4.0) > 0.99


def test_offset_and_covariance_cannot_be_changed() -> None:
    made = offset(np.eye(4))
    for array in (made.mean_mm, made.covariance_mm2):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_the_angle_between_axes_is_in_degrees() -> None:
    assert angle_deg(Line(np.zeros(3), Z), Line(np.ones(3), np.array([0.0, 1.0, 1.0]))) == pytest.approx(45.0)


def test_offsets_are_measured_in_the_planes_across_the_axis() -> None:
    other = Line(np.array([0.3, -0.2, 0.0]), np.array([0.1, 0.0, 1.0]))
    offsets = axis_offset_mm(Line(np.zeros(3), Z), other, np.zeros(3), 10.0 * Z).reshape(2, 2) @ across_basis(Z)
    assert offsets == pytest.approx(np.array([[0.3, -0.2, 0.0], [1.3, -0.2, 0.0]]))


def test_offsets_are_relative_to_entry_and_exit() -> None:
    entry = np.array([5.0, -7.0, 3.0])
    axis, other = Line(entry, Z), Line(np.array([5.3, -7.2, 3.0]), np.array([0.1, 0.0, 1.0]))
    offsets = axis_offset_mm(axis, other, entry, entry + 10.0 * Z).reshape(2, 2) @ across_basis(Z)
    assert offsets == pytest.approx(np.array([[0.3, -0.2, 0.0], [1.3, -0.2, 0.0]]))


def test_across_basis_is_orthonormal_for_any_direction() -> None:
    for direction in [*np.random.default_rng(1).standard_normal((20, 3)), *np.eye(3)]:
        unit = direction / np.linalg.norm(direction)
        basis = np.vstack([across_basis(unit), unit])
        assert basis @ basis.T == pytest.approx(np.eye(3))


def test_across_basis_turns_with_directions_along_which_holes_run() -> None:
    """A step between the bases of two nearly equal directions would turn one offset against the other."""
    usual = across_basis(Z)
    for tilt in np.random.default_rng(2).uniform(-1e-3, 1e-3, (20, 2)):
        direction = np.array([*tilt, 1.0]) / np.linalg.norm([*tilt, 1.0])
        assert across_basis(direction) == pytest.approx(usual, abs=2e-3)


@pytest.mark.parametrize(("mean", "size"), [((0.0,) * 3, 4), ((0.0,) * 4, 3)])
def test_either_wrong_shape_is_refused(mean: tuple[float, ...], size: int) -> None:
    with pytest.raises(ValueError, match="expected shapes"):
        offset(np.eye(size), mean)


def test_shapes_are_checked() -> None:
    with pytest.raises(ValueError, match=r"expected shapes \(4,\) and \(4, 4\), got \(4,\) and \(2, 2\)"):
        offset(np.eye(2))


def test_a_thinner_drill_has_more_room() -> None:
    shift = offset(0.3**2 * np.kron(np.ones((2, 2)), np.eye(2)))
    assert shift.clearance_probability(5.3, 3.2) > shift.clearance_probability(5.3, 4.0) + 0.05
