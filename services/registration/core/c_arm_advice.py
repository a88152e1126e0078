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

from services.registration.core.tuning import DISPLAY_ROTATION
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import angle_between_rad, read_only, rotations_between_rad, unit
from shared.geometry.parts import NailPart, hole_axis, hole_surface_points
from shared.geometry.transform import Transform

# Numerical guards of a fixed-point iteration: it ends far below what anybody sets on a C-arm.
_ITERATIONS = 20
_CONVERGED_RAD = 1e-12


@dataclass(frozen=True, slots=True)
class HoleTilt:
    """Tilt of one hole's axis against the ray through the hole's middle."""

    hole_id: str
    tilt_to_ray_deg: float  # angle between them
    # The same as a rotation from the ray to the axis, about the camera frame's x and y axes, right-handed
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


@dataclass(frozen=True, slots=True, eq=False)
class Advice:
    """How to turn the C-arm."""

    tilts: tuple[HoleTilt, ...]  # of every hole, in the order of the nail's file
    correction: CArmTurn  # turn of the C-arm that takes their mean away
    # Of the nail's rotation about the camera frame's x and y axes, shape (2, 2): that of every tilt and of the
    # correction, because the holes are in one piece of metal
    covariance_deg2: NDArray[np.float64]
    middle_camera_mm: NDArray[np.float64]  # midway between the holes, shape (3,)

    @property
    def about_x_sd_deg(self) -> float:
        """Standard deviation of tilts and correction about the image's x axis."""
        return float(np.sqrt(self.covariance_deg2[0, 0]))

    @property
    def about_y_sd_deg(self) -> float:
        """Standard deviation of tilts and correction about the image's y axis."""
        return float(np.sqrt(self.covariance_deg2[1, 1]))


def hole_tilts(camera_from_nail: Transform[Camera, Nail], nail: NailPart) -> tuple[HoleTilt, ...]:
    """Tilt of every hole against the ray through its middle, in the order of the nail's file."""
    middles, axes = _middles_and_axes(camera_from_nail, nail)
    about = np.degrees(rotations_between_rad(unit(middles), axes))
    return tuple(
        HoleTilt(hole.id, float(np.degrees(angle_between_rad(middle, axis))), float(x), float(y))
        for hole, middle, axis, (x, y, _) in zip(nail.holes, middles, axes, about, strict=True)
    )


def advice(camera_from_nail: Transform[Camera, Nail], covariance: NDArray[np.float64], nail: NailPart) -> Advice:
    """Tilts and correction with what the pose's covariance, shape (6, 6), leaves open.

    Only that of its rotation counts: a tilt against the ray is observed in the hole itself, so that errors of the
    nail's place and of the focal spot move ray and axis together.
    """
    to_camera = camera_from_nail.rotation
    turned_deg2 = np.degrees(np.degrees(to_camera @ covariance[:3, :3] @ to_camera.T))
    return Advice(
        hole_tilts(camera_from_nail, nail),
        c_arm_correction_deg(camera_from_nail, nail),
        read_only(turned_deg2[:2, :2]),
        middle_between_holes_mm(camera_from_nail, nail),
    )


def middle_between_holes_mm(camera_from_nail: Transform[Camera, Nail], nail: NailPart) -> NDArray[np.float64]:
    """Point midway between the holes in the camera's frame, shape (3,), in mm."""
    return np.asarray(_middles_and_axes(camera_from_nail, nail)[0].mean(axis=0))


def c_arm_correction_deg(camera_from_nail: Transform[Camera, Nail], nail: NailPart) -> CArmTurn:
    """Turn of the C-arm after which the mean of the holes' tilts to their rays is zero about both axes.

    To first order it is the mean of the tilts itself; the module's docstring defines it exactly.
    """
    middles, axes = _middles_and_axes(camera_from_nail, nail)
    pivot = middles.mean(axis=0)
    turn_rad = np.zeros(2)
    for _ in range(_ITERATIONS):
        old_from_new = CArmTurn(*np.degrees(turn_rad).tolist()).rotation
        rays = unit((middles - pivot) @ old_from_new + pivot)
        mean = rotations_between_rad(rays, axes @ old_from_new).mean(axis=0)[:2]
        turn_rad = turn_rad + mean
        if float(np.abs(mean).max()) < _CONVERGED_RAD:
            break
    return CArmTurn(*np.degrees(turn_rad).tolist())


def _middles_and_axes(
    camera_from_nail: Transform[Camera, Nail], nail: NailPart
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middles of the holes in mm and directions of their axes, in the camera's frame, shape (H, 3) each."""
    middles = np.array([np.mean(hole_surface_points(nail, hole), axis=0) for hole in nail.holes])
    axes = np.array([hole_axis(nail, hole).direction for hole in nail.holes])
    return camera_from_nail.points(middles), axes @ camera_from_nail.rotation.T


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


def display_rotation_rad(first: AngledView, second: AngledView) -> float | None:
    """Rotation of the camera frame about the beam against the C-arm's axes, from two views of a still guide.

    An image with the C-arm's angles does not show how its display is turned. The direction in which the guide turns in
    the image, compared with the direction in which the angles change, does.

    `None` when the C-arm turned too little between both views, or when the guide turned by another angle than the C-arm
    (it did not stand still, or the angles are not those of these images).
    """
    by_angles = first.angles.room_from_beam.T @ second.angles.room_from_beam
    by_guide = first.camera_from_guide.rotation @ second.camera_from_guide.rotation.T
    expected, observed = (Rotation.from_matrix(turn).as_rotvec(degrees=True)[:2] for turn in (by_angles, by_guide))
    size, observed_size = float(np.linalg.norm(expected)), float(np.linalg.norm(observed))
    if size < DISPLAY_ROTATION.least_turn_deg or abs(observed_size - size) > DISPLAY_ROTATION.largest_mismatch * size:
        return None
    turn = np.arctan2(expected[1], expected[0]) - np.arctan2(observed[1], observed[0])
    return float((turn + np.pi) % (2.0 * np.pi) - np.pi)


def angles_after(angles: CArmAngles, turn: CArmTurn, rotation_rad: float) -> CArmAngles:
    """The C-arm's angles after an advised turn, given the display's rotation (`display_rotation_rad`)."""
    beam_from_camera = Rotation.from_rotvec([0.0, 0.0, rotation_rad]).as_matrix()
    x, y, z = (angles.room_from_beam @ beam_from_camera @ turn.rotation)[:, 2]
    return CArmAngles(float(np.degrees(np.arctan2(-y, z))), float(np.degrees(np.arctan2(x, np.hypot(y, z)))))
