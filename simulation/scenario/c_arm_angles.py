"""How the C-arm is turned, and where its beam points then."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation


@dataclass(frozen=True, slots=True)
class CArmAngles:
    """Rotation about the patient's long axis (orbital), and towards head or feet (angular), in degrees."""

    orbital_deg: float
    angular_deg: float


def c_arm_rotation(angles: CArmAngles, roll_deg: float) -> NDArray[np.float64]:
    """Rotation of the beam's axes in the room, shape (3, 3): orbital about x, then angular about the turned y."""
    turns = Rotation.from_euler("XYZ", [angles.orbital_deg, angles.angular_deg, roll_deg], degrees=True)
    return np.asarray(turns.as_matrix(), dtype=np.float64)


def angles_of_beam(direction_room: NDArray[np.float64]) -> CArmAngles:
    """Angles that point the beam along a direction of the room, shape (3,); inverse of `c_arm_rotation`."""
    x, y, z = direction_room
    return CArmAngles(float(np.degrees(np.arctan2(-y, z))), float(np.degrees(np.arctan2(x, np.hypot(y, z)))))
