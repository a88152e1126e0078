"""Advice in the C-arm's own angles, whatever way the picture is turned on the screen."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from services.registration.core.alignment import CArmTurn
from services.registration.core.guidance.c_arm_angles import AngledView, CArmAngles, angles_after, picture_turn_rad
from services.registration.guidance_report import PictureTurn
from shared.geometry.frames import Camera, Guide
from shared.geometry.transform import Transform

PICTURE_TURN_DEG = 130.0


def view(orbital_deg: float, angular_deg: float, guide_turned_deg: float = 0.0) -> AngledView:
    """A still guide seen by a C-arm whose picture is turned on the screen."""
    room_from_beam = Rotation.from_euler("XY", [orbital_deg, angular_deg], degrees=True)
    beam_from_camera = Rotation.from_euler("z", PICTURE_TURN_DEG, degrees=True)
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
        memory.note(view(orbital_deg, 3.0))
    assert memory.turn_rad is None
    memory.note(view(88.0, 3.0))
    assert memory.turn_rad is not None
    memory.forget_the_guide()
    memory.note(view(88.0, 3.0, guide_turned_deg=20.0))
    memory.note(view(91.0, 3.0, guide_turned_deg=20.0))
    assert np.degrees(memory.turn_rad) == pytest.approx(PICTURE_TURN_DEG, abs=0.2)
