"""Advice in the C-arm's own angles: orbital (about the patient's long axis) and angular (towards head or feet).

An image that carries the C-arm's angles does not say how its picture is turned on the screen. A run of images says it:
while the C-arm turns, the drill guide stands still, and the direction in which it seems to turn in the picture is
compared with the direction in which the angles change.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from services.registration.core.c_arm_advice import CArmTurn
from shared.geometry.frames import Camera, Guide
from shared.geometry.transform import Transform

LEAST_TURN_DEG = 2.0
_LARGEST_MISMATCH = 0.25


@dataclass(frozen=True, slots=True)
class CArmAngles:
    """Positioner angles as DICOM has them: primary (orbital) and secondary (angular), in degrees."""

    orbital_deg: float
    angular_deg: float

    @property
    def room_from_beam(self) -> NDArray[np.float64]:
        """Orientation of source and detector, shape (3, 3): orbital about x, then angular about the turned y."""
        turns = Rotation.from_euler("XY", [self.orbital_deg, self.angular_deg], degrees=True)
        return np.asarray(turns.as_matrix(), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class AngledView:
    """An image with the C-arm's angles, and the guide that stood still in it."""

    angles: CArmAngles
    camera_from_guide: Transform[Camera, Guide]


def picture_turn_rad(first: AngledView, second: AngledView) -> float | None:
    """How the camera's frame is turned about the beam against the C-arm's axes, from two views of a still guide.

    `None` when the C-arm turned by less than two degrees between them, or when the guide seems to have turned by
    another angle than the C-arm (then it did not stand still, or the angles are not those of these images).
    """
    by_angles = first.angles.room_from_beam.T @ second.angles.room_from_beam
    by_guide = first.camera_from_guide.rotation @ second.camera_from_guide.rotation.T
    expected, seen = (Rotation.from_matrix(turn).as_rotvec(degrees=True)[:2] for turn in (by_angles, by_guide))
    size, seen_size = float(np.linalg.norm(expected)), float(np.linalg.norm(seen))
    if size < LEAST_TURN_DEG or abs(seen_size - size) > _LARGEST_MISMATCH * size:
        return None
    turn = np.arctan2(expected[1], expected[0]) - np.arctan2(seen[1], seen[0])
    return float((turn + np.pi) % (2.0 * np.pi) - np.pi)


def angles_after(angles: CArmAngles, turn: CArmTurn, picture_turn: float) -> CArmAngles:
    """Where the C-arm stands after the turn that the advice asks for.

    Parameters
    ----------
    picture_turn
        As `picture_turn_rad` gives it, in rad.
    """
    beam_from_camera = Rotation.from_rotvec([0.0, 0.0, picture_turn]).as_matrix()
    x, y, z = (angles.room_from_beam @ beam_from_camera @ turn.rotation)[:, 2]
    return CArmAngles(float(np.degrees(np.arctan2(-y, z))), float(np.degrees(np.arctan2(x, np.hypot(y, z)))))
