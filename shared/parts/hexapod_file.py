"""Read hexapod files (JSON, millimetres, schema `distalock/hexapod/1`) and refuse what breaks their schema."""

import json
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from shared.errors import PartFileInvalid
from shared.geometry.frames import Guide, RobotTop
from shared.geometry.hexapod import ZERO_POSE, HexapodPart, Interval, PlatformPose, SpeedLimits, Stiffness
from shared.geometry.hexapod_limits import limit_violations
from shared.geometry.hexapod_mount import USUAL_BONE_SCREWS, BoneScrews, MountPlace
from shared.geometry.transform import Transform
from shared.parts.catalogue import DEFAULT_HEXAPOD as DEFAULT_HEXAPOD
from shared.parts.files import Finite, Name, PartModel, Positive, Vector, hash_of, parse_part, read_part_file

ConeDeg = Annotated[float, Field(allow_inf_nan=False, gt=0.0, lt=90.0)]


class LegFile(PartModel):
    """One leg: its joint centres in the base's and in the top's frame."""

    id: Name
    base_joint_mm: Vector
    top_joint_mm: Vector


class RangeFile(PartModel):
    """A closed range."""

    minimum: Finite
    maximum: Finite

    @model_validator(mode="after")
    def _ordered(self) -> "RangeFile":
        if not self.minimum < self.maximum:
            raise ValueError(f"the minimum {self.minimum:g} is not below the maximum {self.maximum:g}")
        return self

    def interval(self) -> Interval:
        """The range as a value."""
        return Interval(self.minimum, self.maximum)


class SpeedLimitsFile(PartModel):
    """Greatest speeds of the platform."""

    translation_mm_per_s: Positive
    rotation_deg_per_s: Positive


class StiffnessFile(PartModel):
    """How the locked robot yields at the guide."""

    translation_n_per_mm: Annotated[float, Field(allow_inf_nan=False, gt=0.0)]
    rotation_nm_per_deg: Annotated[float, Field(allow_inf_nan=False, gt=0.0)]


class PoseFile(PartModel):
    """A pose of the platform."""

    x_mm: Finite
    y_mm: Finite
    z_mm: Finite
    u_deg: Finite
    v_deg: Finite
    w_deg: Finite

    def pose(self) -> PlatformPose:
        """The pose as a value."""
        return PlatformPose(self.x_mm, self.y_mm, self.z_mm, self.u_deg, self.v_deg, self.w_deg)


class HeadFile(PartModel):
    """The head: guide in the top's frame = rotation, and translation at extension 0 plus extension along +x."""

    extension_mm: RangeFile
    top_from_guide_rotation: tuple[Vector, Vector, Vector]
    top_from_guide_translation_at_zero_mm: Vector


class MountFile(PartModel):
    """Where a mount holds the base on a patient, and how exactly: along the base's axes, and how far turned."""

    base_from_nail_rotation: tuple[Vector, Vector, Vector]
    base_from_nail_translation_mm: Vector
    tolerance_mm: tuple[Positive, Positive, Positive]
    tolerance_deg: Annotated[float, Field(allow_inf_nan=False, gt=0.0, le=45.0)]

    def place(self, name: str) -> MountPlace:
        """The mount as a value; raises `ValueError` when its rotation is not one."""
        nail = np.eye(4)
        nail[:3, :3], nail[:3, 3] = self.base_from_nail_rotation, self.base_from_nail_translation_mm
        return MountPlace(name, Transform.from_matrix(nail), np.array(self.tolerance_mm), self.tolerance_deg)


class MountsFile(PartModel):
    """The mounts of which it is known where they hold the base."""

    bone: MountFile | None = None
    nail_head: MountFile | None = None

    def places(self) -> tuple[MountPlace, ...]:
        """As values; raises `ValueError` when a rotation is not one."""
        given = (("bone", self.bone), ("nail_head", self.nail_head))
        return tuple(mount.place(name) for name, mount in given if mount is not None)


class BoneScrewsFile(PartModel):
    """The screws of the mount on the bone: distance of their axes along the nail, and their diameter."""

    spacing_mm: Annotated[float, Field(allow_inf_nan=False, ge=5.0, le=100.0)]
    diameter_mm: Annotated[float, Field(allow_inf_nan=False, gt=0.0, le=10.0)]

    @model_validator(mode="after")
    def _apart(self) -> "BoneScrewsFile":
        if self.spacing_mm <= self.diameter_mm:
            raise ValueError(
                f"bone_screws: screws of {self.diameter_mm:g} mm overlap at a spacing of {self.spacing_mm:g} mm"
            )
        return self


class HexapodFile(PartModel):
    """A hexapod with its head."""

    schema_name: Literal["distalock/hexapod/1"] = Field(alias="schema")
    units: Literal["mm"]
    name: Name
    rotation_order: Literal["Rx(U)*Ry(V)*Rz(W)"]
    legs: tuple[LegFile, ...] = Field(min_length=6, max_length=6)
    leg_length_mm: RangeFile
    base_joint_cone_deg: ConeDeg
    top_joint_cone_deg: ConeDeg
    speed_limits: SpeedLimitsFile
    zero_height_mm: Positive
    home_pose: PoseFile
    pivot_mm: Vector
    stiffness: StiffnessFile
    head: HeadFile
    leg_diameter_mm: Positive | None = None
    mounts: MountsFile | None = None
    bone_screws: BoneScrewsFile | None = None

    @model_validator(mode="after")
    def _leg_names(self) -> "HexapodFile":
        names = [leg.id for leg in self.legs]
        repeated = sorted({n for n in names if names.count(n) > 1})
        if repeated:
            raise ValueError(f"leg id {repeated[0]!r} appears more than once")
        return self


def hexapod_from_json(content: bytes, source: str = "hexapod file") -> HexapodPart:
    """Read a hexapod file's content.

    Raises
    ------
    PartFileInvalid
        When the schema is broken, the head's rotation is not one, or the robot cannot stand in its own zero or home
        pose.
    """
    file = parse_part(HexapodFile, content, source)
    hexapod = _hexapod(file, source)
    for name, pose in (("zero pose", ZERO_POSE), ("home_pose", hexapod.home_pose)):
        violations = limit_violations(hexapod, pose, hexapod.pivot_mm)
        if violations:
            raise PartFileInvalid(f"{source}: {name} is out of reach: {violations[0].message}")
    return hexapod


def hexapod_json_with_head(content: bytes, top_from_guide: NDArray[np.float64], head_extension_mm: float) -> bytes:
    """A hexapod file's content again, with its head as it holds the guide at an extension.

    Parameters
    ----------
    content
        Of a valid file: see `hexapod_from_json`.
    top_from_guide
        A rigid transform as a matrix of shape (4, 4): the same numbers make the same file, to the last digit.
    """
    parsed = json.loads(content)
    retracted_mm = top_from_guide[:3, 3] - np.array([head_extension_mm, 0.0, 0.0])
    parsed["head"]["top_from_guide_rotation"] = top_from_guide[:3, :3].tolist()
    parsed["head"]["top_from_guide_translation_at_zero_mm"] = retracted_mm.tolist()
    return (json.dumps(parsed, indent=1) + "\n").encode()


def _hexapod(file: HexapodFile, source: str) -> HexapodPart:
    guide = np.eye(4)
    guide[:3, :3], guide[:3, 3] = file.head.top_from_guide_rotation, file.head.top_from_guide_translation_at_zero_mm
    try:
        top_from_guide_retracted: Transform[RobotTop, Guide] = Transform.from_matrix(guide)
    except ValueError as error:
        raise PartFileInvalid(f"{source}: head.top_from_guide_rotation: {error}") from None
    try:
        mounts = () if file.mounts is None else file.mounts.places()
    except ValueError as error:
        raise PartFileInvalid(f"{source}: mounts: base_from_nail_rotation: {error}") from None
    return HexapodPart(
        name=file.name,
        leg_ids=tuple(leg.id for leg in file.legs),
        base_joints_mm=np.array([leg.base_joint_mm for leg in file.legs]),
        top_joints_mm=np.array([leg.top_joint_mm for leg in file.legs]),
        leg_length_mm=file.leg_length_mm.interval(),
        base_joint_cone_deg=file.base_joint_cone_deg,
        top_joint_cone_deg=file.top_joint_cone_deg,
        speed_limits=SpeedLimits(file.speed_limits.translation_mm_per_s, file.speed_limits.rotation_deg_per_s),
        zero_height_mm=file.zero_height_mm,
        home_pose=file.home_pose.pose(),
        pivot_mm=np.array(file.pivot_mm),
        stiffness=Stiffness(file.stiffness.translation_n_per_mm, file.stiffness.rotation_nm_per_deg),
        head_extension_mm=file.head.extension_mm.interval(),
        top_from_guide_retracted=top_from_guide_retracted,
        sha256=hash_of(file),
        leg_diameter_mm=file.leg_diameter_mm or 0.0,
        mounts=mounts,
        bone_screws=USUAL_BONE_SCREWS
        if file.bone_screws is None
        else BoneScrews(file.bone_screws.spacing_mm, file.bone_screws.diameter_mm),
    )


def default_hexapod() -> HexapodPart:
    """The hexapod that the product ships; raises `PartFileInvalid` when its file was damaged."""
    return hexapod_from_json(read_part_file(DEFAULT_HEXAPOD), DEFAULT_HEXAPOD.name)
