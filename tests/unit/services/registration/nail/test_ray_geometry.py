"""Rays, nail and bores: the quick look must agree with the exact one."""

import numpy as np
from scipy.spatial.transform import Rotation

from services.registration.core.nail.paths import cylinder_interval
from services.registration.core.nail.ray_geometry import Ray, in_bore, may_touch, tube_of

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
        bore = np.array([rng.uniform(-15.0, 15.0), *rng.uniform(-1.0, 1.0, 2), *axis, 2.5, 5.7])
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
