"""Lengths in metal and plastic, against stepping along the rays."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from services.registration.core.nail.paths import add_ball_paths, guide_body_path, mean_transmission
from shared.geometry.frames import Camera, Guide
from shared.geometry.lines import Line
from shared.geometry.parts import BallPattern, Box, GuidePart, Hole
from shared.geometry.transform import Transform

CENTRE_ONLY = np.zeros((4, 2))
BORES = np.array([[15.0, 0.0, 0.0, 0.0, 0.0, 1.0, 3.0], [-15.0, 0.5, 0.0, 0.0, 0.2, np.sqrt(0.96), 2.5]])
ROTATION = np.ascontiguousarray(Rotation.from_euler("zyx", [40.0, 4.0, -6.0], degrees=True).as_matrix())
PLACE = np.array([3.0, -2.0, 740.0])


def directions(seed: int, count: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    along, across = rng.uniform(-22.0, 22.0, count), rng.uniform(-7.0, 7.0, count)
    points = np.column_stack([along, across, np.zeros(count)]) @ ROTATION.T + PLACE
    return np.ascontiguousarray(points[:, :2] / points[:, 2:])


def transmitted(rays: NDArray[np.float64], cannulation_mm: float) -> NDArray[np.float64]:
    none = np.zeros_like(rays)
    out = np.empty(len(rays))
    steel = np.zeros((len(rays), len(CENTRE_ONLY)))
    crossed = np.ones(len(rays), dtype=bool)
    mean_transmission(
        rays, none, none, CENTRE_ONLY, crossed, steel, ROTATION, PLACE, 6.0, cannulation_mm, BORES, 0.1, 1.0, out
    )
    return out


def stepped_length(rays: NDArray[np.float64], cannulation_mm: float) -> NDArray[np.float64]:
    step = 0.005
    depths = np.arange(725.0, 755.0, step)
    lengths = []
    for x, y in rays:
        ray = np.array([x, y, 1.0])
        p = (depths[:, None] * ray - PLACE) @ ROTATION
        radius = np.hypot(p[:, 1], p[:, 2])
        metal = (radius < 6.0) & (radius > cannulation_mm)
        for bore in BORES:
            off = p - bore[:3]
            off -= np.outer(off @ bore[3:6], bore[3:6])
            metal &= np.linalg.norm(off, axis=1) > bore[6]
        lengths.append(np.count_nonzero(metal) * step * np.linalg.norm(ray))
    return np.array(lengths)


@pytest.mark.parametrize("cannulation_mm", [0.0, 2.2])
def test_metal_is_cylinder_less_bores_less_cannulation(cannulation_mm: float) -> None:
    rays = directions(4, 60)
    length = -np.log(transmitted(rays, cannulation_mm)) / 0.1
    assert np.abs(length - stepped_length(rays, cannulation_mm)).max() < 0.05
    assert np.count_nonzero(length < 1e-9) > 2  # some rays pass through a bore or beside the nail


def test_pixels_that_an_edge_crosses_are_sampled_more_finely() -> None:
    rays = directions(4, 1)
    beside = np.ascontiguousarray(rays + np.array([[1.0, 0.0]]))  # far beside the nail, at its middle
    right = np.ascontiguousarray(rays - beside)  # but half a pixel further lies the nail
    places = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    out = np.empty(1)
    steel = np.full((1, len(places)), 1e3)
    steel[:, :3] = 0.0
    arguments = (ROTATION, PLACE, 6.0, 0.0, BORES, 0.1, 1.0, out)
    mean_transmission(beside, right, np.zeros((1, 2)), places, np.ones(1, dtype=bool), steel, *arguments)
    assert out[0] == pytest.approx(3.0 / 8.0)
    mean_transmission(beside, right, np.zeros((1, 2)), places, np.zeros(1, dtype=bool), steel, *arguments)
    assert out[0] == pytest.approx(1.0)


def test_a_ball_on_the_ray_is_as_thick_as_its_diameter() -> None:
    centres = np.array([[5.0, -3.0, 600.0], [80.0, 0.0, 600.0]])
    rays = np.array([[5.0 / 600.0, -3.0 / 600.0], [0.02, 0.0]])
    out = np.array([0.5, 0.0])
    add_ball_paths(rays, centres, np.array([1.0, 1.0]), out)
    assert out == pytest.approx([2.5, 0.0])


def test_the_guides_body_is_as_thick_as_its_box_and_empty_in_its_bore() -> None:
    no_balls = BallPattern((), np.zeros((0, 3)), np.zeros(0))
    bore = Hole("distal", Line(np.array([10.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])), 8.0)
    guide = GuidePart(no_balls, (bore,), (Box((0.0, 0.0, 0.0), (55.0, 40.0, 15.0)),), "")
    pose = Transform[Camera, Guide].from_rotation_translation(np.eye(3), [0.0, 0.0, 630.0])
    rays = np.array([[0.0, 0.0], [10.0 / 630.0, 0.0], [40.0 / 630.0, 0.0]])
    assert guide_body_path(rays, pose, guide) == pytest.approx([15.0, 0.0, 0.0])
