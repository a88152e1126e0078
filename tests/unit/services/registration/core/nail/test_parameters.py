"""The pose as image points and tilts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from services.registration.core.nail.parameters import (
    CURVATURE,
    Anchors,
    anchors_of,
    clipped_to_bounds,
    motion_by_parameters,
    parameters_from_pose,
    pose_from_parameters,
    prior_mean,
    rotation_and_translation,
)
from services.registration.core.tuning import BENT_NAIL
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import Line
from shared.geometry.parts import Hole, NailPart
from shared.geometry.transform import Transform

CAMERA = PinholeCamera(np.array([[4200.0, 0.0, 510.0], [0.0, 4200.0, 520.0], [0.0, 0.0, 1.0]]))
ANCHORS = Anchors(-15.0, 15.0)


def nail_with_holes_at(*along_mm: float) -> NailPart:
    axis = np.array([0.0, 0.0, 1.0])
    holes = tuple(Hole(f"h{x}", Line(np.array([x, 0.0, 0.0]), axis), 5.0) for x in along_mm)
    return NailPart("steel", 11.0, 0.0, 40.0, holes, "")


def test_level_nail_on_the_optical_axis_has_no_tilt_and_anchors_15_mm_from_the_middle() -> None:
    pose = Transform[Camera, Nail].from_rotation_translation(np.eye(3), [0.0, 0.0, 700.0])
    parameters = parameters_from_pose(pose, CAMERA, ANCHORS)
    assert parameters == pytest.approx([510.0 - 90.0, 520.0, 510.0 + 90.0, 520.0, 0.0, 0.0])


@given(
    st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-3.1, 3.1), st.floats(-40.0, 40.0), st.floats(600.0, 800.0)
)
def test_there_and_back(pitch: float, roll: float, turn: float, aside_mm: float, depth_mm: float) -> None:
    rotation = Rotation.from_euler("zyx", [turn, pitch, roll]).as_matrix()
    pose = Transform[Camera, Nail].from_rotation_translation(rotation, [aside_mm, -aside_mm, depth_mm])
    again = pose_from_parameters(parameters_from_pose(pose, CAMERA, ANCHORS), CAMERA, ANCHORS)
    assert np.abs(again.matrix - pose.matrix).max() < 1e-9


def test_changing_the_sign_of_both_tilts_reflects_the_axis_about_the_mean_ray() -> None:
    parameters = np.array([480.0, 500.0, 600.0, 640.0, 0.05, -0.08])
    mirrored = parameters * np.array([1.0, 1.0, 1.0, 1.0, -1.0, -1.0])
    first, second = (rotation_and_translation(p, CAMERA, ANCHORS)[0][:, 2] for p in (parameters, mirrored))
    ends = CAMERA.rays(parameters[:4].reshape(2, 2)).sum(axis=0)
    ray = ends / np.linalg.norm(ends)
    reflected = 2.0 * ray * (ray @ first) - first
    # the nail's own turn about the ray changes by the product of both tilts
    assert np.linalg.norm(second - reflected) < 2.0 * 0.05 * 0.08


def test_a_small_change_of_the_parameters_is_the_motion_that_it_is_said_to_be() -> None:
    parameters = np.array([480.0, 500.0, 600.0, 640.0, 0.05, -0.08])
    change = np.array([0.3, -0.2, 0.1, 0.4, 0.002, -0.001])
    motion = motion_by_parameters(parameters, CAMERA, ANCHORS) @ change
    expected = pose_from_parameters(parameters + change, CAMERA, ANCHORS)
    found = pose_from_parameters(parameters, CAMERA, ANCHORS) @ Transform[Nail, Nail].from_rotvec(
        motion[:3], motion[3:]
    )
    assert np.abs(found.rotation - expected.rotation).max() < 1e-4
    assert np.abs(found.translation_mm - expected.translation_mm).max() < 0.02


def test_anchors_are_the_outermost_holes() -> None:
    assert anchors_of(nail_with_holes_at(20.0, -10.0, 5.0)) == Anchors(-10.0, 20.0)


def test_a_single_hole_gets_anchors_on_either_side() -> None:
    assert anchors_of(nail_with_holes_at(3.0)) == Anchors(-15.0, 15.0)


@pytest.mark.parametrize("curvature_per_m", [(0.0, 0.0), (3.0, -4.0), (-1900.0, 470.0)])
def test_a_curvature_beyond_its_bound_keeps_its_direction(curvature_per_m: tuple[float, float]) -> None:
    """Starts that reflect the tilts of a hopeless fit had 1900/m, and 3,000 cross-sections to trace rays in."""
    parameters = prior_mean()
    parameters[CURVATURE] = curvature_per_m
    found, given = clipped_to_bounds(parameters)[CURVATURE], np.array(curvature_per_m)
    largest = 1000.0 / BENT_NAIL.bound_radius_mm
    assert np.linalg.norm(found) == pytest.approx(min(np.linalg.norm(given), largest))
    assert found @ given == pytest.approx(np.linalg.norm(found) * np.linalg.norm(given))
