"""Rays through convex shapes, against lengths worked out by hand."""

import numpy as np
import pytest

from simulation.render.shapes import box, ellipsoid, frustum, sphere

DOWN = np.array([0.0, 0.0, 1.0])
ORIGIN = np.zeros(3)


def length(stretch: tuple[float, float]) -> float:
    return max(0.0, stretch[1] - stretch[0])


def test_sphere_is_crossed_along_its_chord() -> None:
    row = np.array([0.6, 0.0, 5.0, 1.0])
    assert sphere(row, ORIGIN, DOWN) == pytest.approx((4.2, 5.8))


def test_sphere_is_missed_beside_it() -> None:
    assert length(sphere(np.array([1.01, 0.0, 5.0, 1.0]), ORIGIN, DOWN)) == 0.0


def test_stretch_is_in_units_of_the_direction() -> None:
    row = np.array([0.0, 0.0, 10.0, 2.0])
    assert sphere(row, ORIGIN, 4.0 * DOWN) == pytest.approx((2.0, 3.0))


def test_ellipsoid_has_its_half_axes() -> None:
    row = np.concatenate([[0.0, 0.0, 10.0], np.diag([1.0, 0.5, 1.0 / 3.0]).ravel()])
    assert ellipsoid(row, ORIGIN, DOWN) == pytest.approx((7.0, 13.0))
    assert length(ellipsoid(row, np.array([0.0, 1.99, 0.0]), DOWN)) == pytest.approx(6.0 * np.sqrt(1 - 0.995**2))
    assert length(ellipsoid(row, np.array([0.0, 2.01, 0.0]), DOWN)) == 0.0


def test_bar_across_the_ray_has_its_chord() -> None:
    row = np.array([0.0, 0.0, 10.0, 1.0, 0.0, 0.0, 5.5, 0.0, -20.0, 20.0])
    assert length(frustum(row, np.array([3.0, 3.0, 0.0]), DOWN)) == pytest.approx(2.0 * np.sqrt(5.5**2 - 9.0))


def test_bar_along_the_ray_has_its_length() -> None:
    row = np.array([0.0, 0.0, 10.0, 0.0, 0.0, 1.0, 2.0, 0.0, -3.0, 4.0])
    assert frustum(row, np.array([1.9, 0.0, 0.0]), DOWN) == pytest.approx((7.0, 14.0))
    assert length(frustum(row, np.array([2.1, 0.0, 0.0]), DOWN)) == 0.0


def test_bar_ends_where_it_says() -> None:
    row = np.array([0.0, 0.0, 10.0, 1.0, 0.0, 0.0, 5.5, 0.0, -20.0, 20.0])
    assert length(frustum(row, np.array([20.1, 0.0, 0.0]), DOWN)) == 0.0


def test_oblique_ray_through_a_bar_is_longer_by_the_cosine() -> None:
    row = np.array([0.0, 0.0, 10.0, 1.0, 0.0, 0.0, 5.0, 0.0, -50.0, 50.0])
    oblique = np.array([np.sin(0.3), 0.0, np.cos(0.3)])
    assert length(frustum(row, ORIGIN, oblique)) == pytest.approx(10.0 / np.cos(0.3))


def test_cone_along_its_axis_is_entered_where_it_is_wide_enough() -> None:
    # Radius 1 at z = 10, growing by 1 mm per mm up to z = 15: at 2.5 mm off the axis it begins at z = 11.5.
    row = np.array([0.0, 0.0, 10.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 5.0])
    assert frustum(row, np.array([2.5, 0.0, 0.0]), DOWN) == pytest.approx((11.5, 15.0))
    assert frustum(row, np.array([0.5, 0.0, 0.0]), DOWN) == pytest.approx((10.0, 15.0))


def test_cone_across_its_axis_has_the_chord_of_its_section() -> None:
    row = np.array([0.0, 0.0, 10.0, 1.0, 0.0, 0.0, 2.0, -0.5, 0.0, 3.0])
    assert length(frustum(row, np.array([1.0, 0.0, 0.0]), DOWN)) == pytest.approx(3.0)


@pytest.mark.parametrize("seed", range(5))
def test_cone_agrees_with_points_inside_it(seed: int) -> None:
    print(f"seed {seed}")
    generator = np.random.default_rng(seed)
    axis = generator.normal(size=3)
    axis /= np.linalg.norm(axis)
    row = np.concatenate([[0.0, 0.0, 10.0], axis, [2.0, generator.uniform(-0.4, 1.5), 0.0, 3.0]])
    t = np.linspace(0.0, 25.0, 200001)
    for _ in range(40):
        origin = np.array([*generator.uniform(-4.0, 4.0, size=2), 0.0])
        direction = np.array([*generator.uniform(-0.3, 0.3, size=2), 1.0])
        offset = origin + t[:, None] * direction - row[:3]
        along = offset @ axis
        across = np.linalg.norm(offset - along[:, None] * axis, axis=1)
        inside = (along >= 0.0) & (along <= 3.0) & (across <= row[6] + row[7] * along)
        assert length(frustum(row, origin, direction)) == pytest.approx(inside.mean() * 25.0, abs=5e-4)


def test_box_is_crossed_in_its_own_axes() -> None:
    row = np.array([0.0, 0.0, 10.0, 3.0, 1.0, 2.0])
    assert box(row, np.eye(3), ORIGIN, DOWN) == pytest.approx((8.0, 12.0))
    turned = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    assert box(row, turned, ORIGIN, DOWN) == pytest.approx((7.0, 13.0))
    assert length(box(row, np.eye(3), np.array([3.1, 0.0, 0.0]), DOWN)) == 0.0
