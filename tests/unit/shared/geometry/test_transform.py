"""Exponential, logarithm and adjoint of rigid transforms, against definitions and numerical differentiation."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from shared.geometry.frames import Camera, Guide
from shared.geometry.lines import cross_matrix
from shared.geometry.transform import Transform

POSE: Transform[Camera, Guide] = Transform.from_rotvec([0.4, -0.8, 1.1], [30.0, -20.0, 70.0])
STEP = 1e-6
TWISTS = np.random.default_rng(7).standard_normal((5, 6)) * np.array([1.0, 1.0, 1.0, 50.0, 50.0, 50.0])


@pytest.mark.parametrize("twist", list(TWISTS))
def test_the_exponential_is_that_of_the_homogeneous_matrix(twist: NDArray[np.float64]) -> None:
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = cross_matrix(twist[:3]), twist[3:]
    np.testing.assert_allclose(Transform.exp(twist).matrix, expm(generator), atol=1e-9)


@pytest.mark.parametrize("twist", list(TWISTS))
def test_the_logarithm_undoes_the_exponential(twist: NDArray[np.float64]) -> None:
    np.testing.assert_allclose(Transform.exp(twist).log(), twist, atol=1e-8)


def test_a_small_motion_moves_points_as_a_rotation_vector_beside_a_translation() -> None:
    point_mm = np.array([12.0, -5.0, 33.0])
    for twist in np.eye(6):
        ahead, behind = (Transform[Guide, Guide].exp(sign * STEP * twist) @ point_mm for sign in (1.0, -1.0))
        velocity = (ahead - behind) / (2.0 * STEP)
        np.testing.assert_allclose(velocity, np.cross(twist[:3], point_mm) + twist[3:], atol=1e-6)


def test_the_adjoint_maps_motions_of_one_frame_to_motions_of_the_other() -> None:
    for column, twist in zip(POSE.adjoint.T, np.eye(6), strict=True):
        ahead, behind = (
            (POSE @ Transform[Guide, Guide].exp(sign * STEP * twist) @ POSE.inverse()).log() for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose((ahead - behind) / (2.0 * STEP), column, atol=1e-6)


def test_the_motion_to_a_moved_pose_is_that_motion() -> None:
    np.testing.assert_allclose(POSE.motion_to(POSE.moved(TWISTS[0])), TWISTS[0], atol=1e-8)
