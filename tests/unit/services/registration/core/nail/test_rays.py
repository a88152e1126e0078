"""Rays, nail and bores: the quick look must agree with the exact one."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from services.registration.core.nail.rays import (
    FIRST_SAMPLES,
    SAMPLES_PX,
    Bore,
    Ray,
    bore_and_rim_near,
    bore_at,
    cylinder_interval,
    in_bore,
    may_touch,
    meets,
    outline_near,
    tube_of,
)

_RADIUS_MM, _INNER_MM, _REACH_MM = 6.0, 2.2, 0.4


def random_rays(count: int) -> list[Ray]:
    """Through points in and beside the nail, within 25° of square to it."""
    rng = np.random.default_rng(5)
    rays = []
    for turn in Rotation.from_rotvec(np.radians(rng.uniform(-25.0, 25.0, (count, 3)))):
        direction = turn.apply([0.0, 0.0, 1.0])
        rays.append((*rng.uniform((-20.0, -9.0, -9.0), (20.0, 9.0, 9.0)), *direction))
    return rays


def test_no_ray_that_touches_a_bore_in_the_nail_is_passed_over() -> None:
    rng = np.random.default_rng(6)
    touching = passed_over = 0
    for ray in random_rays(6000):
        axis = Rotation.from_rotvec(np.radians(rng.uniform(-40.0, 40.0, 3))).apply([0.0, 0.0, 1.0])
        bore: Bore = bore_at(np.array([[rng.uniform(-15.0, 15.0), *rng.uniform(-1.0, 1.0, 2), *axis, 2.5, 5.7]]), 0)
        tube = tube_of(ray, _RADIUS_MM, _INNER_MM)
        first, last = in_bore(ray, bore, _REACH_MM)
        touches = tube[1] > tube[0] and min(last, tube[1]) > max(first, tube[0])
        may = may_touch(ray, tube, bore, _RADIUS_MM, _REACH_MM)
        assert may or not touches
        touching += touches
        passed_over += not may
    assert touching > 400
    assert passed_over > 400


def test_the_tube_is_two_cylinders_about_the_nails_axis() -> None:
    along = (1.0, 0.0, 0.0)
    for ray in random_rays(500):
        found = np.array(tube_of(ray, _RADIUS_MM, _INNER_MM))
        outer, inner = (cylinder_interval(*ray, *along, radius) for radius in (_RADIUS_MM, _INNER_MM))
        assert np.abs(found - np.array([*outer, *inner])).max() < 1e-9


# Second and third coordinate of a point, and a direction
AXIS, TILTED = (0.0, 0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.2, np.sqrt(0.96))


def beside(ray: Ray, rng: np.random.Generator, most_mm: float) -> Ray:
    """A parallel ray less than so far away."""
    direction = np.array(ray[3:])
    across = np.cross(direction, rng.normal(size=3))
    shift = rng.uniform(0.0, most_mm) * across / np.linalg.norm(across)
    return (*(np.array(ray[:3]) + shift), *direction)


@pytest.mark.parametrize("half_slot_mm", [0.0, 2.5])
def test_what_a_ray_beside_would_meet_is_near(half_slot_mm: float) -> None:
    rng = np.random.default_rng(7)
    rows = np.array([[10.0, *AXIS, 3.0, 5.6, half_slot_mm], [-10.0, 0.5, *TILTED, 2.5, 5.7, half_slot_mm]])
    bores = rows[None] if half_slot_mm > 0.0 else rows[:, :8].copy()
    near_count = open_count = edge_count = far_count = 0
    for ray in random_rays(3000):
        near, rim_near = bore_and_rim_near(ray, _RADIUS_MM, _INNER_MM, bores, _REACH_MM)
        edge_near = outline_near(ray, _RADIUS_MM, _INNER_MM, _REACH_MM)
        for other in (beside(ray, rng, _REACH_MM) for _ in range(5)):
            tube = tube_of(other, _RADIUS_MM, _INNER_MM)
            in_nail = tube[1] > tube[0]
            met = [in_nail and meets(other, tube, bore_at(bores, h), _RADIUS_MM, 0.0) for h in range(2)]
            assert near or not any(met)
            if near and not rim_near:
                through = [in_bore(other, bore_at(bores, h), 0.0) for h in range(2)]
                assert not in_nail or any(first <= tube[0] and last >= tube[1] for first, last in through)
            if not edge_near:
                here = tube_of(ray, _RADIUS_MM, _INNER_MM)
                assert (here[1] > here[0], here[3] > here[2]) == (in_nail, tube[3] > tube[2])
        near_count, edge_count = near_count + near, edge_count + edge_near
        open_count, far_count = open_count + (near and not rim_near), far_count + (not near and not edge_near)
    assert min(near_count, edge_count, open_count, far_count) > 20


def test_of_a_bore_narrower_than_nothing_no_ray_is_inside() -> None:
    bore = bore_at(np.array([[0.0, *AXIS, 1.0, 5.6]]), 0)
    first, last = in_bore((0.1, 0.0, 0.0, 0.0, 0.0, 1.0), bore, -1.5)
    assert last < first


def moment_of_a_pixel(column: int, row: int) -> float:
    """Mean of x ** column * y ** row over a square of side one about zero."""
    if column % 2 or row % 2:
        return 0.0
    return float(0.5**column / (column + 1) * 0.5**row / (row + 1))


@pytest.mark.parametrize(("samples", "degree"), [(FIRST_SAMPLES, 3), (len(SAMPLES_PX), 5)])
def test_places_have_a_whole_pixels_moments(samples: int, degree: int) -> None:
    x, y = SAMPLES_PX[:samples].T
    for column, row in product(range(degree + 1), repeat=2):
        if column + row <= degree:
            found = float(np.mean(x**column * y**row))
            assert found == pytest.approx(moment_of_a_pixel(column, row), abs=1e-5), (column, row)


def test_places_lie_in_the_pixel_and_apart() -> None:
    assert np.abs(SAMPLES_PX).max() <= 0.5
    apart = np.linalg.norm(SAMPLES_PX[:, None] - SAMPLES_PX, axis=2)
    assert apart[~np.eye(len(SAMPLES_PX), dtype=bool)].min() > 0.15
