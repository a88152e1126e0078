"""The start pose from rays, on exact rays: nothing is lost by a rough direction or by holes off the nail's axis."""

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.nail.coarse_pose import camera_from_nail_facing, hole_midpoints_mm
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import unit
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform
from tests.unit.services.registration.xray_scene import nail_part, posed_nail


def rays_of(nail: NailPart, pose: Transform[Camera, Nail]) -> NDArray[np.float64]:
    return unit(pose.points(hole_midpoints_mm(nail)))


@pytest.mark.parametrize("rough_deg", [0.0, 25.0, -60.0])
@pytest.mark.parametrize("hole_x_mm", [(15.0, -15.0), (20.0, -10.0, -35.0)])
def test_an_untilted_nail_is_recovered_from_a_rough_direction(hole_x_mm: tuple[float, ...], rough_deg: float) -> None:
    nail, true = nail_part(hole_x_mm), posed_nail(130.0, at_mm=(0.0, 0.0, 712.0))
    rough = posed_nail(130.0 + rough_deg).rotation[:, 0]
    found = camera_from_nail_facing(nail, rays_of(nail, true), np.array([0.0, 0.0, 1.0]), rough, 0.0)
    assert found.matrix == pytest.approx(true.matrix, abs=1e-9)


def test_one_hole_takes_depth_and_direction_from_the_band() -> None:
    nail, true = nail_part((4.0,)), posed_nail(-70.0, at_mm=(0.0, 0.0, 712.0))
    found = camera_from_nail_facing(nail, rays_of(nail, true), np.array([0.0, 0.0, 1.0]), true.rotation[:, 0], 712.0)
    assert found.matrix == pytest.approx(true.matrix, abs=1e-9)


def test_the_holes_axis_is_the_one_asked_for() -> None:
    nail, axis = nail_part(), unit(np.array([0.05, -0.03, 1.0]))
    found = camera_from_nail_facing(nail, rays_of(nail, posed_nail(10.0)), axis, np.array([1.0, 0.2, 0.0]), 0.0)
    assert found.rotation[:, 2] == pytest.approx(axis, abs=1e-12)
