"""Advice in the C-arm's own angles, whatever way the picture is turned on the screen."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from services.registration.core.c_arm_advice import CArmTurn
from services.registration.core.guidance.c_arm_angles import AngledView, CArmAngles, angles_after, picture_turn_rad
from services.registration.guidance_report import PictureTurn, ring_turn_rad
from shared.geometry.frames import Camera, Guide, Ring
from shared.geometry.transform import Transform
from tests.unit.services.registration.xray_scene import calibration

PICTURE_TURN_DEG = 130.0
RING_TURN_RAD = 3.1


def view(
    orbital_deg: float, angular_deg: float, guide_turned_deg: float = 0.0, display_turned_deg: float = 0.0
) -> AngledView:
    """A still guide seen by a C-arm whose picture is turned on the screen."""
    room_from_beam = Rotation.from_euler("XY", [orbital_deg, angular_deg], degrees=True)
    beam_from_camera = Rotation.from_euler("z", PICTURE_TURN_DEG - display_turned_deg, degrees=True)
    room_from_guide = Rotation.from_euler("xyz", [80.0 + guide_turned_deg, 12.0, 40.0], degrees=True)
    rotation = (room_from_beam * beam_from_camera).inv() * room_from_guide
    guide: Transform[Camera, Guide] = Transform.from_rotation_translation(rotation.as_matrix(), [0.0, 0.0, 600.0])
    return AngledView(CArmAngles(orbital_deg, angular_deg), guide)


def test_the_pictures_turn_follows_from_two_views_of_a_still_guide() -> None:
    turn = picture_turn_rad(view(85.0, 3.0), view(88.0, 5.0))
    assert turn is not None
    assert np.degrees(turn) == pytest.approx(PICTURE_TURN_DEG, abs=0.2)


def test_two_views_from_nearly_the_same_place_say_nothing() -> None:
    assert picture_turn_rad(view(85.0, 3.0), view(86.5, 3.0)) is None


def test_a_guide_that_turned_meanwhile_says_nothing() -> None:
    assert picture_turn_rad(view(85.0, 3.0), view(88.0, 5.0, guide_turned_deg=3.0)) is None


def test_the_angles_after_a_turn_point_the_beam_where_the_turn_points_it() -> None:
    now, turn = CArmAngles(85.0, 3.0), CArmTurn(2.0, -3.0)
    then = angles_after(now, turn, float(np.radians(PICTURE_TURN_DEG)))
    beam_from_camera = Rotation.from_euler("z", PICTURE_TURN_DEG, degrees=True).as_matrix()
    expected = now.room_from_beam @ beam_from_camera @ turn.rotation @ np.array([0.0, 0.0, 1.0])
    assert then.room_from_beam[:, 2] == pytest.approx(expected, abs=1e-9)
    assert (then.orbital_deg, then.angular_deg) != pytest.approx((85.0, 3.0), abs=0.5)


def test_a_run_teaches_the_pictures_turn_and_a_moved_guide_does_not_spoil_it() -> None:
    memory = PictureTurn()
    for orbital_deg in (85.0, 86.5):
        memory.note(view(orbital_deg, 3.0), RING_TURN_RAD)
    assert memory.turn_rad is None
    memory.note(view(88.0, 3.0), RING_TURN_RAD)
    assert memory.turn_rad is not None
    memory.forget_the_guide()
    memory.note(view(88.0, 3.0, guide_turned_deg=20.0), RING_TURN_RAD)
    memory.note(view(91.0, 3.0, guide_turned_deg=20.0), RING_TURN_RAD + np.radians(1.0))
    assert np.degrees(memory.turn_rad) == pytest.approx(PICTURE_TURN_DEG, abs=0.2)


@pytest.mark.parametrize("display_turned_deg", [10.0, 90.0, 180.0, -90.0])
def test_a_display_that_was_turned_is_learned_anew(display_turned_deg: float) -> None:
    memory, shown = PictureTurn(), RING_TURN_RAD + np.radians(display_turned_deg)
    for orbital_deg in (85.0, 88.0):
        memory.note(view(orbital_deg, 3.0), RING_TURN_RAD)
    assert memory.turn_rad is not None
    # from here on the picture is another, and the guide in it turned with it
    memory.note(view(90.5, 3.0, display_turned_deg=display_turned_deg), shown)
    assert memory.turn_rad is None
    memory.note(view(93.0, 3.0, display_turned_deg=display_turned_deg), shown)
    assert memory.turn_rad is not None
    apart = np.degrees(memory.turn_rad) - (PICTURE_TURN_DEG - display_turned_deg)
    assert (apart + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.3)


def test_the_ring_tells_how_the_picture_is_turned() -> None:
    ring: Transform[Camera, Ring] = Transform.from_rotvec([0.0, 0.0, 0.7], [1.0, 2.0, 900.0])
    assert ring_turn_rad(replace(calibration(64), camera_from_ring=ring)) == pytest.approx(0.7)
    assert ring_turn_rad(None) is None
