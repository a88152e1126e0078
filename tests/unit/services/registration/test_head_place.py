"""The first image: a guide on turned, and a head extension that does not fit the mount."""

from dataclasses import replace

import numpy as np
import pytest

from services.registration.core.head.place import HeadRefused, HeadTrouble, check_place
from shared.geometry.frames import Guide, Nail, RobotBase
from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top
from shared.geometry.hexapod_mount import MountPlace
from shared.geometry.transform import Transform
from shared.parts.hexapod_file import default_hexapod

POSE = PlatformPose(1.0, -2.0, 0.5, 3.0, -2.0, 4.0)
EXTENSION_MM = 60.0
SEEN: Transform[Guide, Nail] = Transform.from_rotvec(np.radians([2.0, -3.0, 1.5]), [2.0, -3.0, 105.0])


def with_mount(off_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> HexapodPart:
    """A robot whose file knows where the mount on the nail's head holds it; the nail is off from there."""
    hexapod = default_hexapod()
    true = base_from_top(hexapod, POSE, hexapod.pivot_mm) @ hexapod.top_from_guide(EXTENSION_MM) @ SEEN
    designed: Transform[RobotBase, Nail] = Transform.from_rotation_translation(
        true.rotation, true.translation_mm - off_mm
    )
    mount = MountPlace("nail_head", designed, np.array([3.0, 5.0, 5.0]), 10.0)
    return replace(hexapod, mounts=(mount,))


def checked(hexapod: HexapodPart, entered_mm: float = EXTENSION_MM, mount: str = "nail_head") -> HeadRefused | None:
    return check_place(hexapod, POSE, entered_mm, SEEN, mount)


def test_what_fits_the_mount_is_let_pass() -> None:
    assert checked(with_mount()) is None
    assert checked(with_mount((2.9, -4.9, 4.9))) is None


@pytest.mark.parametrize(("entered_mm", "fitting"), [(50.0, "60 mm would fit"), (70.0, "60 mm would fit")])
def test_an_extension_entered_10_mm_wrong_is_noticed_from_the_first_image(entered_mm: float, fitting: str) -> None:
    refused = checked(with_mount(), entered_mm)
    assert refused is not None
    assert refused.code is HeadTrouble.HEAD_EXTENSION
    assert f"{entered_mm - 60.0:+.1f}"[:3] in refused.message
    assert f"entered as {entered_mm:g} mm, {fitting}" in refused.message
    assert "(limit 3 mm)" in refused.message


def test_a_mount_that_sits_elsewhere_is_told() -> None:
    refused = checked(with_mount((0.0, 6.0, -7.0)))
    assert refused is not None
    assert refused.code is HeadTrouble.MOUNT_PLACE
    assert "+6.0 mm along y (limit 5 mm), -7.0 mm along z (limit 5 mm)" in refused.message


def test_of_a_mount_that_no_file_describes_only_directions_are_known() -> None:
    assert checked(with_mount((0.0, 60.0, -70.0)), mount="bone") is None
    assert checked(default_hexapod(), entered_mm=45.0) is None


@pytest.mark.parametrize("turn_deg", [(0.0, 0.0, 180.0), (0.0, 0.0, 90.0), (180.0, 0.0, 0.0), (0.0, 35.0, 0.0)])
def test_a_guide_on_turned_is_noticed_from_the_first_image(turn_deg: tuple[float, float, float]) -> None:
    turned: Transform[Guide, Guide] = Transform.from_rotvec(np.radians(turn_deg), np.zeros(3))
    refused = check_place(default_hexapod(), POSE, EXTENSION_MM, turned @ SEEN, "bone")
    assert refused is not None
    assert refused.code is HeadTrouble.GUIDE_TURNED
    assert "(limit 30°)" in refused.message
    assert "put the guide on the head with its distal mark to the distal end" in refused.message
