"""The things with known shapes: ring, guide, nail. Frozen values with read-only arrays, in millimetres."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shared.geometry.lines import Line

Material = Literal["steel", "Ti6Al4V"]


@dataclass(frozen=True, slots=True, eq=False)
class BallPattern:
    """Steel balls of a ring or a guide.

    Attributes
    ----------
    ids
        Name of each ball.
    position_mm
        Centres in the part's frame, shape (N, 3).
    diameter_mm
        Shape (N,).
    tolerance_mm
        Standard deviation of each centre along each axis, shape (N,); None where the file states none.
    """

    ids: tuple[str, ...]
    position_mm: NDArray[np.float64]
    diameter_mm: NDArray[np.float64]
    tolerance_mm: NDArray[np.float64] | None = None

    @property
    def position_sd_mm(self) -> NDArray[np.float64]:
        """The tolerance, 0 where none is stated, shape (N,)."""
        return np.zeros(len(self.ids)) if self.tolerance_mm is None else self.tolerance_mm

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, slots=True)
class Plate:
    """A round radiolucent plate of the ring, across its z axis."""

    z_mm: float
    radius_mm: float
    thickness_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class RingPart:
    """The calibration ring on the detector."""

    balls: BallPattern
    plates: tuple[Plate, ...]
    sha256: str


@dataclass(frozen=True, slots=True, eq=False)
class Hole:
    """A cylindrical hole of a guide or a nail.

    Attributes
    ----------
    axis
        Directed along drilling, in the part's frame, through the point the part's file gives.
    chamfer_mm
        Depth to which both rims are countersunk at 45 degrees, under the part's widest place; None where nobody says.
    """

    id: str
    axis: Line
    diameter_mm: float
    chamfer_mm: float | None = None


@dataclass(frozen=True, slots=True)
class Box:
    """An axis-aligned block of Delrin: centre and full size in mm."""

    centre_mm: tuple[float, float, float]
    size_mm: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class GuidePart:
    """The drill guide.

    Attributes
    ----------
    frame_tolerance_mm, frame_tolerance_deg
        Standard deviations, along and about each axis, of the place and direction of all balls together against the
        holes; None where none is stated.
    """

    balls: BallPattern
    holes: tuple[Hole, ...]
    body: tuple[Box, ...]
    sha256: str
    frame_tolerance_mm: float | None = None
    frame_tolerance_deg: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class NailPart:
    """The distal end of a nail. Its axis is the x axis; it ends at `tip_x_mm`.

    Attributes
    ----------
    tolerance_mm, tolerance_deg
        Standard deviations of each hole's place and direction, along and about each axis; None where none is stated.
    """

    material: Material
    diameter_mm: float
    cannulation_diameter_mm: float
    tip_x_mm: float
    holes: tuple[Hole, ...]
    sha256: str
    tolerance_mm: float | None = None
    tolerance_deg: float | None = None

    @property
    def radius_mm(self) -> float:
        """Outer radius."""
        return 0.5 * self.diameter_mm


def hole_surface_points(nail: NailPart, hole: Hole) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where a hole's axis enters and leaves the nail's surface, in the nail's frame.

    Returns
    -------
    tuple of arrays
        Entry (the side where drilling begins) and exit, shape (3,) each, in mm.

    Raises
    ------
    ValueError
        When the axis does not cross the nail.
    """
    try:
        return crossings_of_cylinder(hole.axis, nail.radius_mm)
    except ValueError:
        raise ValueError(
            f"the axis of hole '{hole.id}' does not cross the nail of {nail.diameter_mm} mm diameter"
        ) from None


def crossings_of_cylinder(axis: Line, radius_mm: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where a line enters and leaves a cylinder about the x axis, shape (3,) each; raises `ValueError` if nowhere."""
    p, d = axis.point_mm[1:], axis.direction[1:]
    a, b, c = float(d @ d), float(p @ d), float(p @ p) - radius_mm**2
    if a == 0.0 or b * b <= a * c:
        raise ValueError(f"the line does not cross a cylinder of {radius_mm} mm radius")
    root = np.sqrt(b * b - a * c)
    near, far = (-b - root) / a, (-b + root) / a
    return axis.point_mm + near * axis.direction, axis.point_mm + far * axis.direction
