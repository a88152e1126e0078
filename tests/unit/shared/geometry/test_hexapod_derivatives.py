"""Jacobian, singular poses and distances between legs, against brute force."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shared.geometry.hexapod import HexapodPart, PlatformPose, leg_lengths_mm, pose_values, rotation_translation
from shared.geometry.hexapod_inverse import leg_lengths_of_many_mm
from shared.geometry.hexapod_jacobian import leg_jacobians, singularity_margins
from shared.geometry.hexapod_legs import PAIRS, leg_clearances_mm, leg_distances_mm
from shared.geometry.hexapod_limits import HexapodLimit, limit_violations, within_limits
from shared.parts.hexapod_file import default_hexapod

SPREAD = np.array([10.0, 10.0, 8.0, 12.0, 12.0, 12.0])
PIVOT_MM = np.array([60.0, -3.0, 20.0])


@pytest.fixture(scope="module")
def hexapod() -> HexapodPart:
    return default_hexapod()


def some_poses(seed: int, count: int) -> NDArray[np.float64]:
    return np.asarray(np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 6)) * SPREAD)


def test_the_fast_inverse_is_the_inverse(hexapod: HexapodPart) -> None:
    poses = some_poses(1, 10000)
    fast = leg_lengths_of_many_mm(hexapod, poses, PIVOT_MM)
    np.testing.assert_allclose(fast, leg_lengths_mm(hexapod, poses, PIVOT_MM), atol=1e-11)
    assert leg_lengths_of_many_mm(hexapod, poses[:0], PIVOT_MM).shape == (0, 6)


def test_the_jacobian_is_the_derivative_of_the_leg_lengths(hexapod: HexapodPart) -> None:
    poses = some_poses(2, 50)
    jacobians = leg_jacobians(hexapod, poses, PIVOT_MM)
    small = 1e-5
    for axis in range(6):
        ends = [leg_lengths_mm(hexapod, moved(hexapod, poses, axis, step), PIVOT_MM) for step in (small, -small)]
        np.testing.assert_allclose((ends[0] - ends[1]) / (2 * small), jacobians[..., axis], atol=2e-7)


def moved(hexapod: HexapodPart, poses: NDArray[np.float64], axis: int, step: float) -> NDArray[np.float64]:
    """Displaced (axes 0 to 2, mm) or turned about the pivot (3 to 5, rad), in the base's frame."""
    rotation, translation = rotation_translation(hexapod, poses, PIVOT_MM)
    vector = np.zeros(6)
    vector[axis] = step
    turn = Rotation.from_rotvec(vector[3:]).as_matrix()
    pivot = rotation @ PIVOT_MM + translation
    turned = turn @ rotation
    return pose_values(hexapod, turned, pivot + vector[:3] - turned @ PIVOT_MM, PIVOT_MM)


def test_the_margin_to_singular_poses_depends_neither_on_the_pivot_nor_on_units(hexapod: HexapodPart) -> None:
    poses = some_poses(3, 20)
    rotation, translation = rotation_translation(hexapod, poses, PIVOT_MM)
    about_origin = pose_values(hexapod, rotation, translation, np.zeros(3))
    there = singularity_margins(hexapod, poses, PIVOT_MM)
    np.testing.assert_allclose(singularity_margins(hexapod, about_origin, np.zeros(3)), there, rtol=1e-9)
    assert (there > 0.2).all()


def test_a_platform_turned_until_it_gives_way_is_singular(hexapod: HexapodPart) -> None:
    # Turned by 90 degrees about z, the legs of this robot no longer resist a small turn about z (Fichter, 1986).
    turned = np.zeros((181, 6))
    turned[:, 5] = np.linspace(0.0, 180.0, 181)
    margins = singularity_margins(hexapod, turned, np.zeros(3))
    assert margins[0] > 0.3
    assert margins.min() < 0.01
    assert margins[int(np.argmin(margins)) - 5] > margins.min()


def test_a_nearly_singular_pose_is_refused_with_figures(hexapod: HexapodPart) -> None:
    loose = replace(
        hexapod,
        leg_length_mm=replace(hexapod.leg_length_mm, maximum=200.0),
        base_joint_cone_deg=179.0,
        leg_diameter_mm=0.0,
    )
    loose = replace(loose, top_joint_cone_deg=179.0)
    angles = np.linspace(0.0, 180.0, 721)
    poses = np.zeros((len(angles), 6))
    poses[:, 5] = angles
    worst = poses[int(np.argmin(singularity_margins(loose, poses, np.zeros(3))))]
    violations = limit_violations(loose, PlatformPose.from_array(worst), np.zeros(3))
    assert HexapodLimit.SINGULARITY in {v.limit for v in violations}
    assert "the limit is 0.1" in next(v.message for v in violations if v.limit is HexapodLimit.SINGULARITY)
    assert not within_limits(loose, worst, np.zeros(3))


def test_distances_between_legs_are_those_of_the_nearest_points(hexapod: HexapodPart) -> None:
    poses = some_poses(4, 30)
    distances = leg_distances_mm(hexapod, poses, PIVOT_MM)
    rotation, translation = rotation_translation(hexapod, poses, PIVOT_MM)
    tops = hexapod.top_joints_mm @ np.swapaxes(rotation, -1, -2) + translation[:, None]
    shares = np.linspace(0.0, 1.0, 101)[:, None, None, None]
    points = hexapod.base_joints_mm + shares * (tops - hexapod.base_joints_mm)
    for k, (i, j) in enumerate(PAIRS):
        apart = np.linalg.norm(points[:, None, :, i] - points[None, :, :, j], axis=-1).min(axis=(0, 1))
        assert (distances[:, k] <= apart + 1e-9).all()
        np.testing.assert_allclose(distances[:, k], apart, atol=0.06)


def test_legs_that_would_touch_are_named_with_their_distance(hexapod: HexapodPart) -> None:
    thick = replace(hexapod, leg_diameter_mm=9.15)
    pose = PlatformPose(0.0, 0.0, 0.0, 0.0, 0.0, 20.0)
    (clearance,) = leg_clearances_mm(thick, pose.as_array()[None], np.zeros(3))
    assert clearance < 0.0
    violations = [v for v in limit_violations(thick, pose, np.zeros(3)) if v.limit is HexapodLimit.LEG_INTERFERENCE]
    assert violations[0].message.startswith("the axes of legs 1 and 6 would be 9.")
    assert "they are 9.15 mm thick; remount" in violations[0].message
    assert not within_limits(thick, pose.as_array(), np.zeros(3))
    assert within_limits(hexapod, pose.as_array(), np.zeros(3))
