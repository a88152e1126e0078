"""Screw moves: one rotation about, and one translation along, a single axis that stays where it is.

The controller moves straight in X Y Z U V W; a controller that interpolates in space instead goes along the screw. Both
ends being the same, the two ways part in the middle, and a move is permitted only when both are free.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top, pose_values
from shared.geometry.hexapod_limits import PATH_STEP_DEG, PATH_STEP_MM, LimitViolation, violations_along


def screw_path(
    hexapod: HexapodPart, start: PlatformPose, end: PlatformPose, pivot_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Poses along the screw from one pose to another.

    Parameters
    ----------
    pivot_mm
        Centre of rotation in the top's frame, shape (3,), that all poses refer to.

    Returns
    -------
    NDArray
        X Y Z (mm) and U V W (degrees), shape (N, 6), both ends included; the pivot is displaced by at most 0.05 mm, and
        the platform turned by at most 0.05 degrees, from each to the next.
    """
    first, last = base_from_top(hexapod, start, pivot_mm).rigid, base_from_top(hexapod, end, pivot_mm).rigid
    # Steps in the top's own frame: the screw is the same seen from either.
    twist = (first.inv() * last).as_exp_coords()
    turn_deg = math.degrees(float(np.linalg.norm(twist[:3])))
    # The pivot's way along the screw: its velocity is constant in size.
    way_mm = float(np.linalg.norm(twist[3:] + np.cross(twist[:3], pivot_mm)))
    count = math.ceil(max(way_mm / PATH_STEP_MM, turn_deg / PATH_STEP_DEG, 1.0)) + 1
    shares = np.linspace(0.0, 1.0, count)
    matrices = (first * RigidTransform.from_exp_coords(shares[:, None] * twist)).as_matrix()
    return pose_values(hexapod, matrices[:, :3, :3], matrices[:, :3, 3], pivot_mm)


def screw_violations(
    hexapod: HexapodPart, start: PlatformPose, end: PlatformPose, pivot_mm: NDArray[np.float64]
) -> tuple[LimitViolation, ...]:
    """Which limits the screw from one pose to another breaks, where it first does; empty when none."""
    return violations_along(hexapod, screw_path(hexapod, start, end, pivot_mm), pivot_mm)
