"""Tilts to the rays and the C-arm's correction, against numbers worked out by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from services.registration.core.c_arm_advice import CArmTurn, advice, c_arm_correction_deg, hole_tilts, turned
from shared.geometry.frames import Camera, Nail
from shared.geometry.transform import Transform
from tests.unit.services.registration.xray_scene import nail_part


def nail_pose(rotation: Rotation, at_mm: tuple[float, float, float]) -> Transform[Camera, Nail]:
    return Transform.from_rotation_translation(rotation.as_matrix(), np.array(at_mm))


def test_tilts_of_a_nail_across_the_axis() -> None:
    # Holes at x = +-15 mm, 700 mm deep, both along the axis. The ray through the hole at +15 leans towards +x by
    # atan(15/700) = 1.2276 degrees. From that ray to +z is a turn towards -x: negative about y.
    distal, proximal = hole_tilts(nail_pose(Rotation.identity(), (0.0, 0.0, 700.0)), nail_part())
    assert (distal.hole_id, proximal.hole_id) == ("distal", "proximal")
    assert (distal.about_x_deg, distal.about_y_deg) == pytest.approx((0.0, -1.2276), abs=1e-4)
    assert (proximal.about_x_deg, proximal.about_y_deg) == pytest.approx((0.0, 1.2276), abs=1e-4)
    assert distal.tilt_to_ray_deg == pytest.approx(1.2276, abs=1e-4)


def test_tilts_of_a_nail_turned_by_3_degrees_about_y() -> None:
    # R = Ry(3): the hole at +15 is at (14.9794, 0, 699.2150), its ray leans by 1.2273 degrees: 3 - 1.2273 = 1.7727.
    # The hole at -15 is at (-14.9794, 0, 700.7850), its ray leans by -1.2245 degrees: 3 + 1.2245 = 4.2245.
    pose = nail_pose(Rotation.from_euler("y", 3.0, degrees=True), (0.0, 0.0, 700.0))
    distal, proximal = hole_tilts(pose, nail_part())
    assert (distal.about_x_deg, distal.about_y_deg) == pytest.approx((0.0, 1.7727), abs=1e-4)
    assert (proximal.about_x_deg, proximal.about_y_deg) == pytest.approx((0.0, 4.2245), abs=1e-4)


@pytest.mark.parametrize(("axis", "expected"), [("x", (3.0, 0.0)), ("y", (0.0, 3.0))])
def test_a_nail_turned_by_3_degrees_needs_a_c_arm_turned_by_3_degrees_the_same_way(
    axis: str, expected: tuple[float, float]
) -> None:
    # The camera turned by Ry(3) looks along (sin 3, 0, cos 3), which is where the nail's holes point.
    turn = c_arm_correction_deg(nail_pose(Rotation.from_euler(axis, 3.0, degrees=True), (0.0, 0.0, 700.0)), nail_part())
    assert (turn.about_x_deg, turn.about_y_deg) == pytest.approx(expected, abs=0.002)


def test_a_nail_beside_the_axis_is_turned_to_its_own_rays() -> None:
    # 70 mm to the right at 700 mm the ray leans by atan(0.1) = 5.7106 degrees; holes along +z are tilted by as much
    # to the other side, and the camera has to look less to the right of them: about -y.
    pose = nail_pose(Rotation.from_euler("z", 90.0, degrees=True), (70.0, 0.0, 700.0))
    turn = c_arm_correction_deg(pose, nail_part())
    assert (turn.about_x_deg, turn.about_y_deg) == pytest.approx((0.0, -5.71), abs=0.01)


def test_after_the_correction_the_mean_tilt_is_zero_and_the_holes_are_where_they_were() -> None:
    nail = nail_part()
    pose = nail_pose(Rotation.from_euler("zxy", [50.0, 6.0, -7.0], degrees=True), (12.0, -9.0, 720.0))
    after = turned(pose, nail, c_arm_correction_deg(pose, nail))
    tilts = hole_tilts(after, nail)
    assert np.mean([t.about_x_deg for t in tilts]) == pytest.approx(0.0, abs=1e-9)
    assert np.mean([t.about_y_deg for t in tilts]) == pytest.approx(0.0, abs=1e-9)
    assert after.translation_mm == pytest.approx(pose.translation_mm, abs=1e-9)


def test_a_turn_moves_the_nail_the_other_way_in_the_cameras_frame() -> None:
    after = turned(nail_pose(Rotation.identity(), (0.0, 0.0, 700.0)), nail_part(), CArmTurn(0.0, 2.0))
    assert after.rotation[:, 2] == pytest.approx([-np.sin(np.radians(2.0)), 0.0, np.cos(np.radians(2.0))])


def test_a_nail_without_tilt_needs_no_correction() -> None:
    turn = c_arm_correction_deg(nail_pose(Rotation.identity(), (0.0, 0.0, 700.0)), nail_part())
    assert (turn.about_x_deg, turn.about_y_deg) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_the_advice_tells_how_sure_it_is_about_the_images_axes() -> None:
    # The nail lies along the image's y axis: what is uncertain about its own x axis is so about the image's y axis.
    pose = nail_pose(Rotation.from_euler("z", 90.0, degrees=True), (0.0, 0.0, 700.0))
    covariance = np.diag([*np.radians([0.3, 0.1, 5.0]) ** 2, 1.0, 1.0, 9.0])
    told = advice(pose, covariance, nail_part())
    assert (told.about_x_sd_deg, told.about_y_sd_deg) == pytest.approx((0.1, 0.3), abs=1e-6)
    assert told.tilts == hole_tilts(pose, nail_part())
    assert told.correction == c_arm_correction_deg(pose, nail_part())
