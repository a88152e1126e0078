"""Where a mount holds the robot's base on a patient: what a first image can be compared with."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.frames import Nail, RobotBase
from shared.geometry.lines import read_only
from shared.geometry.transform import Transform

# By the definition of the frames (+x distal in both, +z of the base against, of the nail along the drilling).
_USUAL_ROTATION = np.diag([1.0, -1.0, -1.0])
# A mount puts the guide near the holes by hand: what is turned by more is not mounted as it should be.
USUAL_TOLERANCE_DEG = 30.0


@dataclass(frozen=True, slots=True)
class BoneScrews:
    """The two screws that hold the base on the bone, side by side along the nail, their middle under the base's."""

    spacing_mm: float
    diameter_mm: float


# Self-tapping screws of the published prototype.
USUAL_BONE_SCREWS = BoneScrews(spacing_mm=25.0, diameter_mm=5.0)


@dataclass(frozen=True, slots=True, eq=False)
class MountPlace:
    """Where a mount holds the base, and how exactly.

    Attributes
    ----------
    name
        `bone` or `nail_head`.
    base_from_nail
        As designed.
    tolerance_mm
        How far the nail may be from there, along the base's axes, shape (3,).
    tolerance_deg
        And how far turned.
    """

    name: str
    base_from_nail: Transform[RobotBase, Nail]
    tolerance_mm: NDArray[np.float64]
    tolerance_deg: float

    def __post_init__(self) -> None:
        if self.tolerance_mm.shape != (3,):
            raise ValueError(f"expected a tolerance of shape (3,), got {self.tolerance_mm.shape}")
        object.__setattr__(self, "tolerance_mm", read_only(self.tolerance_mm))


def usual_place(name: str) -> MountPlace:
    """A mount of which no file says where it holds the base: then only the directions are known, roughly."""
    nowhere: Transform[RobotBase, Nail] = Transform.from_rotation_translation(_USUAL_ROTATION, np.zeros(3))
    return MountPlace(name, nowhere, np.full(3, np.inf), USUAL_TOLERANCE_DEG)
