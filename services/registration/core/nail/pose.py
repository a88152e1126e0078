"""The nail's pose as image points and tilts: the parametrisation in which the fit is well conditioned.

Two *anchors* on the nail's axis (at the outermost hole positions) are seen in the image at two ideal pixels; `pitch`
turns the nail about its own y axis away from the plane across the mean ray, `roll` turns it about its own axis. The
mirror image of a tilt is then a change of sign of pitch or roll, with the anchors where they are.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import unit
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform

POSE_SIZE = 6
_MINIMAL_ANCHOR_DISTANCE_MM = 5.0
_DEFAULT_ANCHOR_MM = 15.0


@dataclass(frozen=True, slots=True)
class Anchors:
    """Places on the nail's axis whose images carry the pose, as x in the nail's frame (first < second), in mm."""

    first_x_mm: float
    second_x_mm: float


def anchors_of(nail: NailPart) -> Anchors:
    """Outermost hole positions, or 15 mm on either side of the origin when the holes are closer than 5 mm."""
    along = [float(hole.axis.point_mm[0]) for hole in nail.holes]
    if max(along) - min(along) < _MINIMAL_ANCHOR_DISTANCE_MM:
        return Anchors(-_DEFAULT_ANCHOR_MM, _DEFAULT_ANCHOR_MM)
    return Anchors(min(along), max(along))


def pose_from_parameters(
    parameters: NDArray[np.float64], camera: PinholeCamera, anchors: Anchors
) -> Transform[Camera, Nail]:
    """Pose from (first anchor x, y, second anchor x, y in ideal px, pitch, roll in rad), shape (6,)."""
    return Transform.from_rotation_translation(*rotation_and_translation(parameters, camera, anchors))


def rotation_and_translation(
    parameters: NDArray[np.float64], camera: PinholeCamera, anchors: Anchors
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The same pose as bare arrays, shapes (3, 3) and (3,), for the inner loop: there, checks would take longest."""
    first, second = camera.rays(parameters[:4].reshape(2, 2))
    pitch, roll = float(parameters[4]), float(parameters[5])
    middle = unit(first + second)
    half_angle = np.arctan2(np.linalg.norm(second - first), np.linalg.norm(second + first))
    distance = anchors.second_x_mm - anchors.first_x_mm
    total = distance * np.cos(pitch) / np.sin(half_angle)
    difference = distance * np.sin(pitch) / np.cos(half_angle)
    near_end = 0.5 * (total - difference) * first
    far_end = 0.5 * (total + difference) * second
    x = unit(far_end - near_end)
    level = unit(middle - x * float(middle @ x))
    y_level = np.cross(level, x)
    z = np.cos(roll) * level - np.sin(roll) * y_level
    rotation = np.column_stack([x, np.cross(z, x), z])
    return np.ascontiguousarray(rotation), near_end - anchors.first_x_mm * x


def parameters_from_pose(
    camera_from_nail: Transform[Camera, Nail], camera: PinholeCamera, anchors: Anchors
) -> NDArray[np.float64]:
    """Inverse of `pose_from_parameters`, shape (6,)."""
    ends = camera_from_nail.points(np.array([[anchors.first_x_mm, 0.0, 0.0], [anchors.second_x_mm, 0.0, 0.0]]))
    directions = unit(ends)
    middle = unit(directions[0] + directions[1])
    x, _, z = camera_from_nail.rotation.T
    level = unit(middle - x * float(middle @ x))
    y_level = np.cross(level, x)
    pitch = np.arctan2(float(x @ middle), float(np.linalg.norm(np.cross(x, middle))))
    roll = np.arctan2(-float(z @ y_level), float(z @ level))
    return np.concatenate([camera.project(ends).ravel(), [pitch, roll]])
