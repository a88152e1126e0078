"""Lengths in metal and plastic where they are known."""

import numpy as np
import pytest

from services.registration.core.nail.paths import Balls, add_ball_paths, guide_body_path
from services.registration.core.nail.pixel_rays import PixelRays
from shared.geometry.frames import Camera, Guide
from shared.geometry.lines import Line
from shared.geometry.parts import BallPattern, Box, GuidePart, Hole
from shared.geometry.transform import Transform


def test_a_ball_on_the_ray_is_as_thick_as_its_diameter() -> None:
    centres = np.array([[5.0, -3.0, 600.0], [80.0, 0.0, 600.0]])
    slopes = np.array([[5.0 / 600.0, -3.0 / 600.0], [0.02, 0.0]])
    nothing = np.zeros_like(slopes)
    out = np.array([[0.5], [0.0]])
    balls = Balls(centres, np.array([1.0, 1.0]), np.ones(2))
    add_ball_paths(PixelRays(slopes, nothing, nothing), np.zeros((1, 2)), balls, out)
    assert out[:, 0] == pytest.approx([2.5, 0.0])


@pytest.mark.parametrize(("spread", "path_mm"), [(0.5, 2.0 * np.sqrt(1.0 - 0.25**2)), (2.2, 0.0)])
def test_a_ball_is_looked_at_as_far_from_the_middle_of_a_pixel_as_its_spread_says(
    spread: float, path_mm: float
) -> None:
    far, slopes = 1e6, np.zeros((1, 2))
    rays = PixelRays(slopes, np.array([[1.0 / far, 0.0]]), np.array([[0.0, 1.0 / far]]))
    out = np.zeros((1, 1))
    balls = Balls(np.array([[0.0, 0.0, far]]), np.ones(1), np.array([spread]))
    add_ball_paths(rays, np.array([[0.3, -0.4]]), balls, out)
    assert out[0, 0] == pytest.approx(path_mm, abs=1e-3)


def test_the_guides_body_is_as_thick_as_its_box_and_empty_in_its_bore() -> None:
    no_balls = BallPattern((), np.zeros((0, 3)), np.zeros(0))
    bore = Hole("distal", Line(np.array([10.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])), 8.0)
    guide = GuidePart(no_balls, (bore,), (Box((0.0, 0.0, 0.0), (55.0, 40.0, 15.0)),), "")
    pose = Transform[Camera, Guide].from_rotation_translation(np.eye(3), [0.0, 0.0, 630.0])
    slopes = np.array([[0.0, 0.0], [10.0 / 630.0, 0.0], [40.0 / 630.0, 0.0]])
    nothing = np.zeros_like(slopes)
    middle = np.zeros((1, 2))
    assert guide_body_path(PixelRays(slopes, nothing, nothing), middle, pose, guide) == pytest.approx([15.0, 0.0, 0.0])


def test_a_pixel_across_the_bodys_side_sees_the_mean_of_its_places() -> None:
    no_balls = BallPattern((), np.zeros((0, 3)), np.zeros(0))
    guide = GuidePart(no_balls, (), (Box((0.0, 0.0, 0.0), (40.0, 40.0, 1e-3)),), "")
    pose = Transform[Camera, Guide].from_rotation_translation(np.eye(3), [0.0, 0.0, 600.0])
    slopes, step = np.array([[0.0, 20.0 / 600.0]]), np.array([[1.0 / 600.0, 0.0]])
    places = np.array([[0.0, -0.4], [0.0, -0.1], [0.0, 0.1], [0.4, -0.2]])
    found = guide_body_path(PixelRays(slopes, step, step[:, ::-1].copy()), places, pose, guide)
    assert found == pytest.approx([0.75e-3], rel=2e-3)
