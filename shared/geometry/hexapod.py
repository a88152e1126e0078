"""The six-legged robot: where its platform stands, and how long its legs are then.

Frames: `RobotBase` has its origin in the middle of the base joints, +x distal (as the guide's), +z away from the bone
(against the direction of drilling). `RobotTop` has its origin in the middle of the top joints and, in the zero pose,
the same directions, `zero_height_mm` above the base.

A pose is what the controller calls X Y Z U V W: the platform is turned by Rx(U)·Ry(V)·Rz(W) about the pivot (given in
the top's frame, the controller's R S T), and the pivot is displaced by X Y Z from where it is in the zero pose.

Limits and straight moves are in `hexapod_limits`, screw moves in `hexapod_screw`, forward kinematics in
`hexapod_forward`, derivatives in `hexapod_jacobian`, distances between legs in `hexapod_legs`, and millions of poses at
once in `hexapod_inverse` and `hexapod_workspace`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shared.geometry.frames import Guide, RobotBase, RobotTop
from shared.geometry.hexapod_mount import USUAL_BONE_SCREWS, BoneScrews, MountPlace, usual_place
from shared.geometry.lines import read_only
from shared.geometry.transform import Transform

# What the word says.
LEGS = 6
AXES = ("X", "Y", "Z", "U", "V", "W")


@dataclass(frozen=True, slots=True)
class PlatformPose:
    """Displacement of the pivot (mm) and rotation Rx(U)·Ry(V)·Rz(W) of the platform (degrees); zero is mid-height."""

    x_mm: float
    y_mm: float
    z_mm: float
    u_deg: float
    v_deg: float
    w_deg: float

    @staticmethod
    def from_array(values: ArrayLike) -> "PlatformPose":
        """Build from X Y Z (mm) and U V W (degrees), shape (6,)."""
        array = np.asarray(values, dtype=np.float64)
        if array.shape != (6,):
            raise ValueError(f"expected X Y Z U V W, shape (6,), got {array.shape}")
        return PlatformPose(*(float(v) for v in array))

    def as_array(self) -> NDArray[np.float64]:
        """X Y Z (mm) and U V W (degrees), shape (6,)."""
        return np.array([self.x_mm, self.y_mm, self.z_mm, self.u_deg, self.v_deg, self.w_deg])


ZERO_POSE = PlatformPose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Interval:
    """A closed range; its unit is in the name of the attribute that holds it."""

    minimum: float
    maximum: float

    def contains(self, value: float) -> bool:
        """Whether the value is in the range, ends included; NaN is not."""
        return self.minimum <= value <= self.maximum


@dataclass(frozen=True, slots=True)
class SpeedLimits:
    """Greatest speeds of the platform."""

    translation_mm_per_s: float
    rotation_deg_per_s: float


@dataclass(frozen=True, slots=True)
class Stiffness:
    """How the locked robot yields at the guide."""

    translation_n_per_mm: float
    rotation_nm_per_deg: float


@dataclass(frozen=True, slots=True, eq=False)
class HexapodPart:
    """A six-legged robot with the head that carries the guide.

    Attributes
    ----------
    name
        What people call it.
    leg_ids
        Names of the legs, six.
    base_joints_mm, top_joints_mm
        Centres of the legs' joints, in `RobotBase` and `RobotTop`, shape (6, 3).
    leg_length_mm
        Shortest and longest leg, joint centre to joint centre.
    base_joint_cone_deg, top_joint_cone_deg
        Greatest angle between a leg and its direction in the zero pose, as seen by the base and by the top: each joint
        is mounted along its leg in the zero pose.
    zero_height_mm
        Height of the top joints' plane above the base joints' plane in the zero pose.
    home_pose
        Where it stands before a case, and after reference.
    pivot_mm
        Default centre of rotation in `RobotTop`, shape (3,).
    head_extension_mm
        The range in which the head can be set by hand, along the top's x axis.
    top_from_guide_retracted
        Pose of the guide at head extension 0 (which cannot be set: it only anchors the scale).
    sha256
        Of what its file says (`shared.parts.canonical`).
    leg_diameter_mm
        Thickness of a leg; 0 when the file does not give it: then legs may come as near to one another as lines can.
    mounts
        Where its mounts hold it, as far as the file describes it.
    bone_screws
        The screws of the mount on the bone.
    """

    name: str
    leg_ids: tuple[str, ...]
    base_joints_mm: NDArray[np.float64]
    top_joints_mm: NDArray[np.float64]
    leg_length_mm: Interval
    base_joint_cone_deg: float
    top_joint_cone_deg: float
    speed_limits: SpeedLimits
    zero_height_mm: float
    home_pose: PlatformPose
    pivot_mm: NDArray[np.float64]
    stiffness: Stiffness
    head_extension_mm: Interval
    top_from_guide_retracted: Transform[RobotTop, Guide]
    sha256: str
    leg_diameter_mm: float = 0.0
    mounts: tuple[MountPlace, ...] = ()
    bone_screws: BoneScrews = USUAL_BONE_SCREWS

    def __post_init__(self) -> None:
        if self.base_joints_mm.shape != (LEGS, 3) or self.top_joints_mm.shape != (LEGS, 3):
            raise ValueError(
                "expected joint centres of shape (6, 3), got "
                f"{self.base_joints_mm.shape} and {self.top_joints_mm.shape}"
            )
        if self.pivot_mm.shape != (3,):
            raise ValueError(f"expected a pivot of shape (3,), got {self.pivot_mm.shape}")
        for name in ("base_joints_mm", "top_joints_mm", "pivot_mm"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def top_from_guide(self, head_extension_mm: float) -> Transform[RobotTop, Guide]:
        """Pose of the guide on the platform, for a head set to this extension.

        Raises
        ------
        ValueError
            When the head cannot be set to this extension.
        """
        if not self.head_extension_mm.contains(head_extension_mm):
            raise ValueError(
                f"head extension is {head_extension_mm:g} mm, the head of '{self.name}' can be set from "
                f"{self.head_extension_mm.minimum:g} to {self.head_extension_mm.maximum:g} mm; read its scale again"
            )
        retracted = self.top_from_guide_retracted
        along_x = np.array([head_extension_mm, 0.0, 0.0])
        return Transform.from_rotation_translation(retracted.rotation, retracted.translation_mm + along_x)

    def mount(self, name: str) -> MountPlace:
        """Where a mount holds the base: as the file describes it, or what is known of any mount."""
        return next((mount for mount in self.mounts if mount.name == name), usual_place(name))


def rotation_of(uvw_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrices Rx(U)·Ry(V)·Rz(W), shape (..., 3, 3), of angles in degrees, shape (..., 3)."""
    angles = np.radians(uvw_deg)
    (su, sv, sw), (cu, cv, cw) = (np.moveaxis(f(angles), -1, 0) for f in (np.sin, np.cos))
    rows = [
        [cv * cw, -cv * sw, sv],
        [cu * sw + su * sv * cw, cu * cw - su * sv * sw, -su * cv],
        [su * sw - cu * sv * cw, su * cw + cu * sv * sw, cu * cv],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_translation(
    hexapod: HexapodPart, poses: NDArray[np.float64], pivot_mm: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotations, shape (..., 3, 3), and translations in mm, shape (..., 3), of the top in the base."""
    rotation = rotation_of(poses[..., 3:])
    pivot_in_base = poses[..., :3] + pivot_mm + np.array([0.0, 0.0, hexapod.zero_height_mm])
    return rotation, pivot_in_base - rotation @ pivot_mm


def base_from_top(
    hexapod: HexapodPart, pose: PlatformPose, pivot_mm: NDArray[np.float64]
) -> Transform[RobotBase, RobotTop]:
    """Where the platform stands in a pose, with the rotation about a pivot in the top's frame, shape (3,), in mm."""
    return Transform.from_rotation_translation(*rotation_translation(hexapod, pose.as_array(), pivot_mm))


def platform_pose(
    hexapod: HexapodPart, base_from_top: Transform[RobotBase, RobotTop], pivot_mm: NDArray[np.float64]
) -> PlatformPose:
    """X Y Z U V W that put the platform there: the inverse of `base_from_top`, for tilts below 90 degrees.

    Parameters
    ----------
    pivot_mm
        Centre of rotation in the top's frame, shape (3,).
    """
    rotation, translation_mm = base_from_top.rotation, base_from_top.translation_mm
    return PlatformPose.from_array(pose_values(hexapod, rotation, translation_mm, pivot_mm))


def pose_values(
    hexapod: HexapodPart,
    rotation: NDArray[np.float64],
    translation_mm: NDArray[np.float64],
    pivot_mm: NDArray[np.float64],
) -> NDArray[np.float64]:
    """X Y Z (mm) and U V W (degrees), shape (..., 6), of rotations (..., 3, 3) and translations (..., 3) of the top."""
    r = rotation
    u = np.arctan2(-r[..., 1, 2], r[..., 2, 2])
    v = np.arctan2(r[..., 0, 2], np.hypot(r[..., 0, 0], r[..., 0, 1]))
    w = np.arctan2(-r[..., 0, 1], r[..., 0, 0])
    pivot_at_zero = pivot_mm + np.array([0.0, 0.0, hexapod.zero_height_mm])
    xyz_mm = r @ pivot_mm + translation_mm - pivot_at_zero
    return np.concatenate([xyz_mm, np.degrees(np.stack([u, v, w], axis=-1))], axis=-1)


def leg_vectors_mm(
    hexapod: HexapodPart, poses: NDArray[np.float64], pivot_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Vectors from base joints to top joints in `RobotBase`, shape (..., 6, 3), in mm.

    Parameters
    ----------
    poses
        X Y Z (mm) and U V W (degrees), shape (..., 6).
    pivot_mm
        Centre of rotation in the top's frame, shape (3,).
    """
    rotation, translation = rotation_translation(hexapod, poses, pivot_mm)
    top_joints = hexapod.top_joints_mm @ np.swapaxes(rotation, -1, -2) + translation[..., None, :]
    return np.asarray(top_joints - hexapod.base_joints_mm)


def leg_lengths_mm(
    hexapod: HexapodPart, poses: NDArray[np.float64], pivot_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Lengths of the legs, shape (..., 6), in mm, for poses X Y Z (mm) U V W (degrees), shape (..., 6)."""
    legs = leg_vectors_mm(hexapod, poses, pivot_mm)
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", legs, legs)))
