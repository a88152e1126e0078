"""Where the hexapod can stand and which straight moves it can make, with sentences for people when it cannot."""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from shared.geometry.hexapod import ZERO_POSE, HexapodPart, PlatformPose, leg_lengths_mm, leg_vectors_mm, rotation_of
from shared.geometry.hexapod_jacobian import singularity_margins
from shared.geometry.hexapod_legs import PAIRS, leg_clearances_mm, leg_distances_mm

# As fine as the robot's position is read back.
PATH_STEP_MM = 0.05
PATH_STEP_DEG = 0.05
# Below this, a leg's error and its give are magnified more than tenfold.
LEAST_SINGULARITY_MARGIN = 0.1


class HexapodLimit(StrEnum):
    """Kinds of limits."""

    LEG_LENGTH = "leg_length"
    BASE_JOINT = "base_joint_angle"
    TOP_JOINT = "top_joint_angle"
    LEG_INTERFERENCE = "leg_interference"
    SINGULARITY = "singularity"
    NOT_FINITE = "not_finite"


@dataclass(frozen=True, slots=True)
class LimitViolation:
    """One limit that a pose breaks.

    Attributes
    ----------
    limit
        Which kind.
    message
        One sentence for people.
    """

    limit: HexapodLimit
    message: str


def joint_angles_deg(
    hexapod: HexapodPart, poses: NDArray[np.float64], pivot_mm: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angles between each leg and its direction in the zero pose, as seen by the base and by the top.

    Parameters
    ----------
    poses
        X Y Z (mm) and U V W (degrees), shape (..., 6).
    pivot_mm
        Centre of rotation in the top's frame, shape (3,).

    Returns
    -------
    tuple of arrays
        Base and top joints, shape (..., 6) each, in degrees.
    """
    zero_legs = leg_vectors_mm(hexapod, ZERO_POSE.as_array(), pivot_mm)
    legs = leg_vectors_mm(hexapod, poses, pivot_mm)
    legs_in_top = legs @ rotation_of(poses[..., 3:])
    return _angles_deg(legs, zero_legs), _angles_deg(legs_in_top, zero_legs)


def _angles_deg(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    across = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.asarray(np.degrees(np.arctan2(across, np.sum(a * b, axis=-1))))


def limit_margins(
    hexapod: HexapodPart, poses: NDArray[np.float64], pivot_mm: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far poses are from the nearest limit of legs and joints; negative outside.

    Parameters
    ----------
    poses
        X Y Z (mm) and U V W (degrees), shape (..., 6).
    pivot_mm
        Centre of rotation in the top's frame, shape (3,).

    Returns
    -------
    tuple of arrays
        Margin of the leg nearest to an end of its travel in mm, and of the joint nearest to its cone in degrees,
        shape (...) each.
    """
    lengths = leg_lengths_mm(hexapod, poses, pivot_mm)
    at_base, at_top = joint_angles_deg(hexapod, poses, pivot_mm)
    leg_margin = np.minimum(lengths - hexapod.leg_length_mm.minimum, hexapod.leg_length_mm.maximum - lengths)
    joint_margin = np.minimum(hexapod.base_joint_cone_deg - at_base, hexapod.top_joint_cone_deg - at_top)
    return leg_margin.min(axis=-1), joint_margin.min(axis=-1)


def within_limits(hexapod: HexapodPart, poses: NDArray[np.float64], pivot_mm: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each pose (X Y Z in mm, U V W in degrees, shape (..., 6)) is within all limits, shape (...)."""
    flat = poses.reshape(-1, poses.shape[-1])
    leg_margin, joint_margin = limit_margins(hexapod, flat, pivot_mm)
    inside = (leg_margin >= 0.0) & (joint_margin >= 0.0)
    # The dearer questions are asked of those alone that are left.
    left = flat[inside]
    inside[inside] = leg_clearances_mm(hexapod, left, pivot_mm) >= 0.0
    left = flat[inside]
    inside[inside] = singularity_margins(hexapod, left, pivot_mm) >= LEAST_SINGULARITY_MARGIN
    return inside.reshape(poses.shape[:-1])


def limit_violations(
    hexapod: HexapodPart, pose: PlatformPose, pivot_mm: NDArray[np.float64]
) -> tuple[LimitViolation, ...]:
    """Which limits a pose breaks; empty when the robot can stand there."""
    values = pose.as_array()
    if not np.isfinite(values).all():
        return (LimitViolation(HexapodLimit.NOT_FINITE, f"the pose {values.tolist()} is not made of finite numbers"),)
    lengths = leg_lengths_mm(hexapod, values, pivot_mm)
    at_base, at_top = joint_angles_deg(hexapod, values, pivot_mm)
    return (
        *_leg_violations(hexapod, lengths),
        *_joint_violations(hexapod, at_base, hexapod.base_joint_cone_deg, HexapodLimit.BASE_JOINT),
        *_joint_violations(hexapod, at_top, hexapod.top_joint_cone_deg, HexapodLimit.TOP_JOINT),
        *_interferences(hexapod, leg_distances_mm(hexapod, values, pivot_mm)),
        *_singularity(float(singularity_margins(hexapod, values, pivot_mm))),
    )


def _leg_violations(hexapod: HexapodPart, lengths_mm: NDArray[np.float64]) -> tuple[LimitViolation, ...]:
    limits = hexapod.leg_length_mm
    return tuple(
        LimitViolation(
            HexapodLimit.LEG_LENGTH,
            f"leg {name} would be {length:.2f} mm long, it can be {limits.minimum:g} to {limits.maximum:g} mm; "
            "remount the robot so that the guide starts nearer to the holes",
        )
        for name, length in zip(hexapod.leg_ids, lengths_mm, strict=True)
        if not limits.contains(float(length))
    )


def _joint_violations(
    hexapod: HexapodPart, angles_deg: NDArray[np.float64], cone_deg: float, limit: HexapodLimit
) -> tuple[LimitViolation, ...]:
    place = "base" if limit is HexapodLimit.BASE_JOINT else "top"
    return tuple(
        LimitViolation(
            limit,
            f"the {place} joint of leg {name} would bend by {angle:.1f}°, its limit is {cone_deg:g}°; "
            "remount the robot so that the guide starts nearer to the holes",
        )
        for name, angle in zip(hexapod.leg_ids, angles_deg, strict=True)
        if not angle <= cone_deg
    )


def _interferences(hexapod: HexapodPart, distances_mm: NDArray[np.float64]) -> tuple[LimitViolation, ...]:
    return tuple(
        LimitViolation(
            HexapodLimit.LEG_INTERFERENCE,
            f"the axes of legs {hexapod.leg_ids[i]} and {hexapod.leg_ids[j]} would be {distance:.2f} mm apart, they "
            f"are {hexapod.leg_diameter_mm:g} mm thick; remount the robot so that the guide starts nearer to the holes",
        )
        for (i, j), distance in zip(PAIRS, distances_mm, strict=True)
        if not distance >= hexapod.leg_diameter_mm
    )


def _singularity(margin: float) -> tuple[LimitViolation, ...]:
    if margin >= LEAST_SINGULARITY_MARGIN:
        return ()
    return (
        LimitViolation(
            HexapodLimit.SINGULARITY,
            f"the platform would nearly give way: in one direction its legs change by {margin:.3f} mm for each mm it "
            f"moves, the limit is {LEAST_SINGULARITY_MARGIN:g}; remount the robot so that the guide starts nearer to "
            "the holes",
        ),
    )


def straight_path(start: PlatformPose, end: PlatformPose) -> NDArray[np.float64]:
    """Poses along a move in which all six axes run linearly and together, as the controller moves.

    Returns
    -------
    NDArray
        X Y Z (mm) and U V W (degrees), shape (N, 6), both ends included, at most 0.05 mm and 0.05 degrees apart: a leg
        between two of them differs from the nearer by less than 0.1 mm.
    """
    first, last = start.as_array(), end.as_array()
    travel = np.abs(last - first)
    steps_mm = float(np.linalg.norm(travel[:3])) / PATH_STEP_MM
    steps_deg = float(np.linalg.norm(travel[3:])) / PATH_STEP_DEG
    return np.linspace(first, last, math.ceil(max(steps_mm, steps_deg, 1.0)) + 1)


def path_violations(
    hexapod: HexapodPart, start: PlatformPose, end: PlatformPose, pivot_mm: NDArray[np.float64]
) -> tuple[LimitViolation, ...]:
    """Which limits a straight move breaks where it first leaves the workspace; empty when it stays inside."""
    for pose in (start, end):
        violations = limit_violations(hexapod, pose, pivot_mm)
        if violations:
            return violations
    return violations_along(hexapod, straight_path(start, end), pivot_mm)


def violations_along(
    hexapod: HexapodPart, path: NDArray[np.float64], pivot_mm: NDArray[np.float64]
) -> tuple[LimitViolation, ...]:
    """Which limits a path (X Y Z in mm, U V W in degrees, shape (N, 6)) breaks where it first does; empty when none."""
    outside = np.flatnonzero(~within_limits(hexapod, path, pivot_mm))
    if not len(outside):
        return ()
    share = 100.0 * outside[0] / (len(path) - 1)
    return tuple(
        LimitViolation(v.limit, f"after {share:.0f} % of the way, {v.message}")
        for v in limit_violations(hexapod, PlatformPose.from_array(path[outside[0]]), pivot_mm)
    )
