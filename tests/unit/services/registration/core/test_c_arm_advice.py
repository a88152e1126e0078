"""Tilts to the rays and the C-arm's correction, against numbers worked out by hand; the C-arm's own angles."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from services.registration.core.c_arm_advice import (
    AngledView,
    CArmAngles,
    CArmTurn,
    advice,
    angles_after,
    c_arm_correction_deg,
    display_rotation_rad,
    hole_tilts,
)
from services.registration.guidance_report import DisplayRotationMemory, ring_rotation_rad
from shared.geometry.frames import Camera, Guide, Nail, Ring
from shared.geometry.transform import Transform
from tests.unit.services.registration.xray_scene import calibration, nail_part, turned

DISPLAY_ROTATION_DEG = 130.0
RING_ROTATION_RAD = 3.1


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


@pytest.mark.requirement("REG-13")
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


def view(
    orbital_deg: float, angular_deg: float, guide_turned_deg: float = 0.0, display_turned_deg: float = 0.0
) -> AngledView:
    """A still guide seen by a C-arm whose picture is turned on the screen."""
    room_from_beam = Rotation.from_euler("XY", [orbital_deg, angular_deg], degrees=True)
    beam_from_camera = Rotation.from_euler("z", DISPLAY_ROTATION_DEG - display_turned_deg, degrees=True)
    room_from_guide = Rotation.from_euler("xyz", [80.0 + guide_turned_deg, 12.0, 40.0], degrees=True)
    rotation = (room_from_beam * beam_from_camera).inv() * room_from_guide
    guide: Transform[Camera, Guide] = Transform.from_rotation_translation(rotation.as_matrix(), [0.0, 0.0, 600.0])
    return AngledView(CArmAngles(orbital_deg, angular_deg), guide)


def test_the_pictures_turn_follows_from_two_views_of_a_still_guide() -> None:
    turn = display_rotation_rad(view(85.0, 3.0), view(88.0, 5.0))
    assert turn is not None
    assert np.degrees(turn) == pytest.approx(DISPLAY_ROTATION_DEG, abs=0.2)


def test_two_views_from_nearly_the_same_place_say_nothing() -> None:
    assert display_rotation_rad(view(85.0, 3.0), view(86.5, 3.0)) is None


def test_a_guide_that_turned_meanwhile_says_nothing() -> None:
    assert display_rotation_rad(view(85.0, 3.0), view(88.0, 5.0, guide_turned_deg=3.0)) is None


def test_the_angles_after_a_turn_point_the_beam_where_the_turn_points_it() -> None:
    now, turn = CArmAngles(85.0, 3.0), CArmTurn(2.0, -3.0)
    then = angles_after(now, turn, float(np.radians(DISPLAY_ROTATION_DEG)))
    beam_from_camera = Rotation.from_euler("z", DISPLAY_ROTATION_DEG, degrees=True).as_matrix()
    expected = now.room_from_beam @ beam_from_camera @ turn.rotation @ np.array([0.0, 0.0, 1.0])
    assert then.room_from_beam[:, 2] == pytest.approx(expected, abs=1e-9)
    assert (then.orbital_deg, then.angular_deg) != pytest.approx((85.0, 3.0), abs=0.5)


def test_a_run_teaches_the_pictures_turn_and_a_moved_guide_does_not_spoil_it() -> None:
    memory = DisplayRotationMemory()
    for orbital_deg in (85.0, 86.5):
        memory.note(view(orbital_deg, 3.0), RING_ROTATION_RAD)
    assert memory.rotation_rad is None
    memory.note(view(88.0, 3.0), RING_ROTATION_RAD)
    assert memory.rotation_rad is not None
    memory.forget_the_guide()
    memory.note(view(88.0, 3.0, guide_turned_deg=20.0), RING_ROTATION_RAD)
    memory.note(view(91.0, 3.0, guide_turned_deg=20.0), RING_ROTATION_RAD + np.radians(1.0))
    assert np.degrees(memory.rotation_rad) == pytest.approx(DISPLAY_ROTATION_DEG, abs=0.2)


@pytest.mark.parametrize("display_turned_deg", [10.0, 90.0, 180.0, -90.0])
def test_a_display_that_was_turned_is_learned_anew(display_turned_deg: float) -> None:
    memory, shown = DisplayRotationMemory(), RING_ROTATION_RAD + np.radians(display_turned_deg)
    for orbital_deg in (85.0, 88.0):
        memory.note(view(orbital_deg, 3.0), RING_ROTATION_RAD)
    assert memory.rotation_rad is not None
    # from here on the picture is another, and the guide in it turned with it
    memory.note(view(90.5, 3.0, display_turned_deg=display_turned_deg), shown)
    assert memory.rotation_rad is None
    memory.note(view(93.0, 3.0, display_turned_deg=display_turned_deg), shown)
    assert memory.rotation_rad is not None
    apart = np.degrees(memory.rotation_rad) - (DISPLAY_ROTATION_DEG - display_turned_deg)
    assert (apart + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.3)


def test_the_ring_tells_how_the_picture_is_turned() -> None:
    ring: Transform[Camera, Ring] = Transform.from_rotvec([0.0, 0.0, 0.7], [1.0, 2.0, 900.0])
    assert ring_rotation_rad(replace(calibration(64), camera_from_ring=ring)) == pytest.approx(0.7)
