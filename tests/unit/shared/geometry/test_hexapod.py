"""The hexapod's frames and order of rotations, fixed with numbers worked out by hand."""

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.hexapod import (
    ZERO_POSE,
    HexapodPart,
    PlatformPose,
    base_from_top,
    leg_lengths_mm,
    platform_pose,
    rotation_of,
)
from shared.parts.hexapod_file import default_hexapod

NO_PIVOT: NDArray[np.float64] = np.zeros(3)


@pytest.fixture(scope="module")
def hexapod() -> HexapodPart:
    return default_hexapod()


def test_rotation_is_rx_then_ry_then_rz_about_axes_that_move_along() -> None:
    # By hand, for U = V = 90 degrees: Rx maps y to z and z to -y, Ry maps z to x and x to -z.
    # Rx(90) Ry(90) x = Rx(90) (-z) = y;  Rx Ry y = Rx y = z;  Rx Ry z = Rx x = x.
    expected = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    np.testing.assert_allclose(rotation_of(np.array([90.0, 90.0, 0.0])), expected, atol=1e-15)


def test_rotation_about_z_is_applied_first_to_the_platform() -> None:
    # Rx(90) Rz(90): x -> Rz -> y -> Rx -> z;  y -> -x -> -x;  z -> z -> -y.
    expected = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    np.testing.assert_allclose(rotation_of(np.array([90.0, 0.0, 90.0])), expected, atol=1e-15)


def test_all_three_angles_by_hand() -> None:
    # U = 90, V = 30, W = 90: first row (cV cW, -cV sW, sV) = (0, -0.8660254, 0.5); second row
    # (cU sW + sU sV cW, cU cW - sU sV sW, -sU cV) = (0, -0.5, -0.8660254); third row (1, 0, 0).
    half_root_3 = 0.8660254037844386
    expected = np.array([[0.0, -half_root_3, 0.5], [0.0, -0.5, -half_root_3], [1.0, 0.0, 0.0]])
    np.testing.assert_allclose(rotation_of(np.array([90.0, 30.0, 90.0])), expected, atol=1e-15)


def test_the_pivot_stays_where_it_is_when_only_the_angles_change(hexapod: HexapodPart) -> None:
    pivot_mm = np.array([60.0, 0.0, 20.0])
    turned = base_from_top(hexapod, PlatformPose(0.0, 0.0, 0.0, 3.0, -4.0, 5.0), pivot_mm)
    np.testing.assert_allclose(turned @ pivot_mm, pivot_mm + np.array([0.0, 0.0, hexapod.zero_height_mm]), atol=1e-12)


def test_turning_about_a_pivot_60_mm_away_by_hand(hexapod: HexapodPart) -> None:
    # W = 90 degrees about (60, 0, 0): the platform's origin, 60 mm on the -x side, goes to 60 mm on the -y side.
    turned = base_from_top(hexapod, PlatformPose(0.0, 0.0, 0.0, 0.0, 0.0, 90.0), np.array([60.0, 0.0, 0.0]))
    np.testing.assert_allclose(turned.translation_mm, [60.0, -60.0, hexapod.zero_height_mm], atol=1e-12)


def test_zero_pose_is_level_at_mid_height(hexapod: HexapodPart) -> None:
    zero = base_from_top(hexapod, ZERO_POSE, hexapod.pivot_mm)
    np.testing.assert_allclose(zero.rotation, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(leg_lengths_mm(hexapod, ZERO_POSE.as_array(), hexapod.pivot_mm), 45.0, atol=1e-4)


def test_a_leg_by_hand(hexapod: HexapodPart) -> None:
    # Leg 1 of the shipped robot, lifted by 1 mm: base (21.5192, 4.5741, 0), top (12.7279, 12.7279, 44.3731).
    expected = (8.7913**2 + 8.1538**2 + 44.3731**2) ** 0.5
    lengths = leg_lengths_mm(hexapod, PlatformPose(0.0, 0.0, 1.0, 0.0, 0.0, 0.0).as_array(), hexapod.pivot_mm)
    assert lengths[0] == pytest.approx(expected, abs=1e-9)


def test_platform_pose_is_the_inverse(hexapod: HexapodPart) -> None:
    pose = PlatformPose(1.0, -2.0, 3.0, 4.0, -5.0, 6.0)
    back = platform_pose(hexapod, base_from_top(hexapod, pose, hexapod.pivot_mm), hexapod.pivot_mm)
    np.testing.assert_allclose(back.as_array(), pose.as_array(), atol=1e-12)


def test_leg_lengths_do_not_depend_on_which_pivot_describes_the_pose(hexapod: HexapodPart) -> None:
    pose = PlatformPose(1.0, -2.0, 3.0, 4.0, -5.0, 6.0)
    same = platform_pose(hexapod, base_from_top(hexapod, pose, hexapod.pivot_mm), NO_PIVOT)
    np.testing.assert_allclose(
        leg_lengths_mm(hexapod, pose.as_array(), hexapod.pivot_mm),
        leg_lengths_mm(hexapod, same.as_array(), NO_PIVOT),
        atol=1e-12,
    )


def test_many_poses_at_once_agree_with_one_at_a_time(hexapod: HexapodPart) -> None:
    poses = np.random.default_rng(5).uniform(-5.0, 5.0, (7, 6))
    one_by_one = np.array([leg_lengths_mm(hexapod, p, hexapod.pivot_mm) for p in poses])
    np.testing.assert_array_equal(leg_lengths_mm(hexapod, poses, hexapod.pivot_mm), one_by_one)


def test_the_head_carries_the_guide_distally_and_drilling_goes_into_the_bone(hexapod: HexapodPart) -> None:
    near, far = hexapod.top_from_guide(40.0), hexapod.top_from_guide(80.0)
    np.testing.assert_allclose(far.translation_mm - near.translation_mm, [40.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(near.directions(np.array([0.0, 0.0, 1.0])), [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(near.directions(np.array([1.0, 0.0, 0.0])), [1.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("extension_mm", [39.9, 80.1, float("nan")])
def test_an_extension_the_head_cannot_have_is_refused(hexapod: HexapodPart, extension_mm: float) -> None:
    with pytest.raises(ValueError, match=r"can be set from 40 to 80 mm; read its scale again"):
        hexapod.top_from_guide(extension_mm)


def test_a_pose_needs_six_numbers() -> None:
    with pytest.raises(ValueError, match=r"expected X Y Z U V W, shape \(6,\), got \(5,\)"):
        PlatformPose.from_array(np.zeros(5))


def test_shapes_are_checked(hexapod: HexapodPart) -> None:
    values = {name: getattr(hexapod, name) for name in HexapodPart.__dataclass_fields__}
    with pytest.raises(ValueError, match=r"expected joint centres of shape \(6, 3\)"):
        HexapodPart(**(values | {"base_joints_mm": np.zeros((5, 3))}))
    with pytest.raises(ValueError, match=r"expected a pivot of shape \(3,\)"):
        HexapodPart(**(values | {"pivot_mm": np.zeros(2)}))
