"""How far the nail's holes are tilted against the rays through them, and how to turn the C-arm so that they are not.

The tilt of a hole is the rotation that takes the direction of the ray through the hole's middle to the hole's axis; its
components are about the camera frame's x and y axes, right-handed, in degrees. (The component about z is of second
order: it is the product of the tilt and of the ray's own slope.)

The correction is a rotation of source and detector together, as a rotation vector (x, y, 0) in the camera frame, about
the point midway between the holes: a C-arm that is turned and moved so that the holes stay where they are in the image.
(About the focal spot nothing would change: the rays through the holes would stay the same lines in the room.) When the
camera is turned by `R`, a direction `a` of the room appears in its frame as `R' a`; so to take a hole's axis, tilted by
`+t`, back to the ray, the camera is turned by `+t`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import angle_between_rad, unit
from shared.geometry.parts import NailPart, hole_surface_points
from shared.geometry.transform import Transform

_ITERATIONS = 20
_CONVERGED_RAD = 1e-12


@dataclass(frozen=True, slots=True)
class HoleTilt:
    """Tilt of one hole's axis against the ray through the hole's middle.

    Attributes
    ----------
    tilt_to_ray_deg
        Angle between them.
    about_x_deg, about_y_deg
        The same as a rotation from the ray to the axis, about the camera frame's x and y axes, right-handed.
    """

    hole_id: str
    tilt_to_ray_deg: float
    about_x_deg: float
    about_y_deg: float


@dataclass(frozen=True, slots=True)
class CArmTurn:
    """Rotation of source and detector together, about the camera frame's x and y axes, right-handed."""

    about_x_deg: float
    about_y_deg: float

    @property
    def rotation(self) -> NDArray[np.float64]:
        """Orientation of the turned camera in the camera's frame before, shape (3, 3)."""
        vector = np.radians([self.about_x_deg, self.about_y_deg, 0.0])
        return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def hole_tilts(camera_from_nail: Transform[Camera, Nail], nail: NailPart) -> tuple[HoleTilt, ...]:
    """Tilt of every hole against the ray through its middle, in the order of the nail's file."""
    tilts = []
    for hole in nail.holes:
        middle = camera_from_nail @ np.asarray(np.mean(hole_surface_points(nail, hole), axis=0))
        axis = camera_from_nail.directions(hole.axis.direction)
        x, y, _ = np.degrees(_rotation_between_rad(unit(middle), axis))
        angle_deg = float(np.degrees(angle_between_rad(middle, axis)))
        tilts.append(HoleTilt(hole.id, angle_deg, float(x), float(y)))
    return tuple(tilts)


def c_arm_correction_deg(camera_from_nail: Transform[Camera, Nail], nail: NailPart) -> CArmTurn:
    """Turn of the C-arm after which the mean of the holes' tilts to their rays is zero about both axes.

    Returns
    -------
    CArmTurn
        See the module's docstring for the exact definition. To first order it is the mean of the tilts itself.
    """
    turn_rad = np.zeros(2)
    for _ in range(_ITERATIONS):
        turn = CArmTurn(*np.degrees(turn_rad).tolist())
        mean = _mean_tilt_rad(turned(camera_from_nail, nail, turn), nail)
        turn_rad = turn_rad + mean
        if float(np.abs(mean).max()) < _CONVERGED_RAD:
            break
    return CArmTurn(*np.degrees(turn_rad).tolist())


def turned(camera_from_nail: Transform[Camera, Nail], nail: NailPart, turn: CArmTurn) -> Transform[Camera, Nail]:
    """Where the nail is for a C-arm that was turned about the point midway between the holes."""
    middles = np.array([np.mean(hole_surface_points(nail, hole), axis=0) for hole in nail.holes])
    pivot = camera_from_nail @ np.asarray(middles.mean(axis=0))
    new_from_old = turn.rotation.T
    rotation = new_from_old @ camera_from_nail.rotation
    origin = new_from_old @ (camera_from_nail.translation_mm - pivot) + pivot
    return Transform.from_rotation_translation(rotation, origin)


def _mean_tilt_rad(camera_from_nail: Transform[Camera, Nail], nail: NailPart) -> NDArray[np.float64]:
    tilts = hole_tilts(camera_from_nail, nail)
    return np.asarray(np.radians(np.mean([(t.about_x_deg, t.about_y_deg) for t in tilts], axis=0)))


def _rotation_between_rad(start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smallest rotation, as a vector in radians, that takes one unit direction to another, shape (3,)."""
    normal = np.cross(start, end)
    sine = float(np.linalg.norm(normal))
    return np.asarray(normal * (np.arctan2(sine, float(start @ end)) / sine if sine > 0.0 else 1.0))
