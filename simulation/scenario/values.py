"""What a scenario is made of: frozen values, millimetres and degrees (the C-arm's are in `imaging_values`)."""

from dataclasses import dataclass
from enum import StrEnum

from shared.geometry.frames import Bone, Nail, RobotBase, Room
from shared.geometry.hexapod import HexapodPart
from shared.geometry.parts import GuidePart, NailPart, RingPart
from shared.geometry.transform import Transform
from simulation.scenario.bones import BoneKind
from simulation.scenario.imaging_values import CArm, Display, Exposure, FlatPanel, Intensifier


class Side(StrEnum):
    """The patient's side that is operated on."""

    LEFT = "left"
    RIGHT = "right"


def side_of_drilling(bone: BoneKind, side: Side) -> Side:
    """The side of the patient from which is drilled: laterally into the femur, medially into the tibia."""
    if bone is BoneKind.FEMUR:
        return side
    return Side.LEFT if side is Side.RIGHT else Side.RIGHT


class MountKind(StrEnum):
    """What the robot's base is fixed to."""

    BONE = "bone"
    NAIL_HEAD = "nail_head"


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """The manufactured things in the room, as their files describe them."""

    ring: RingPart
    guide: GuidePart
    nail: NailPart
    hexapod: HexapodPart

    @property
    def common_hole_ids(self) -> tuple[str, ...]:
        """Ids of the guide's holes that the nail has too, in the guide's order."""
        of_the_nail = {hole.id for hole in self.nail.holes}
        return tuple(hole.id for hole in self.guide.holes if hole.id in of_the_nail)


@dataclass(frozen=True, slots=True)
class PartSource:
    """Where a part comes from: its name in the product's catalogue, or a file with its content."""

    name: str
    in_catalogue: bool
    content: bytes


@dataclass(frozen=True, slots=True)
class PartSources:
    """Where the parts come from."""

    ring: PartSource
    guide: PartSource
    nail: PartSource
    hexapod: PartSource


@dataclass(frozen=True, slots=True)
class Anatomy:
    """A bone's distal end and what is around it, in the bone's frame: +x distal along the canal, +z as is drilled.

    Of a tibia the two condyles are the medial malleolus, where drilling begins, and the fibula on the far side; the
    thigh is the lower leg. `posterior_y` is +1 or -1: the side of y on which the condyles bulge. Half-axes are given
    along y (front to back) and z (side to side).
    """

    posterior_y: float
    shaft_half_axes_mm: tuple[float, float]
    flare_half_axes_mm: tuple[float, float]
    flare_from_to_mm: tuple[float, float]
    cortex_shaft_mm: float
    cortex_end_mm: float
    condyle_centre_x_mm: tuple[float, float]
    condyle_back_mm: tuple[float, float]
    condyle_half_axes_mm: tuple[tuple[float, float, float], tuple[float, float, float]]
    condyle_spread_mm: float
    spongy_share: float
    texture_contrast: float
    texture_seed: int
    thigh_half_axes_mm: tuple[float, float]
    thigh_centre_mm: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Placement:
    """How patient, nail and robot lie. `bone_from_base` is where the mount holds the robot's base."""

    room_from_bone: Transform[Room, Bone]
    bone_from_nail: Transform[Bone, Nail]
    bone_from_base: Transform[Bone, RobotBase]


@dataclass(frozen=True, slots=True)
class Drilling:
    """The drill, and how the guide yields to it.

    Attributes
    ----------
    force_n
        Range of the sideways force; each drilling has its own.
    stiffness_share
        How stiff the mount leaves the robot: 1 is as stiff as the robot's own file says.
    """

    diameter_mm: float
    force_n: tuple[float, float]
    stiffness_share: float


@dataclass(frozen=True, slots=True)
class MountYield:
    """How the robot's mount yields.

    Attributes
    ----------
    translation_n_per_mm, rotation_nm_per_deg
        Stiffness of the mount, at the base's origin.
    tissue_n_per_mm
        How hard soft tissue pushes the guide back for each millimetre that it was moved.
    """

    translation_n_per_mm: float
    rotation_nm_per_deg: float
    tissue_n_per_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """Everything that does not change during a case, from one seed."""

    seed: int
    side: Side
    mount: MountKind
    head_extension_mm: float
    parts: Parts
    sources: PartSources
    anatomy: Anatomy
    placement: Placement
    c_arm: CArm
    detector: Intensifier | FlatPanel
    exposure: Exposure
    display: Display
    drilling: Drilling
    mount_yield: MountYield | None = None
    bone: BoneKind = BoneKind.FEMUR
