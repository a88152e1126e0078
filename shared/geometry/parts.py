"""The things with known shapes: ring, guide, nail. Frozen values with read-only arrays, in millimetres."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shared.equipment import Bone
from shared.geometry.bend import section_frame
from shared.geometry.frames import Nail
from shared.geometry.lines import Line, unit
from shared.geometry.transform import Transform

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
    """A hole of a guide or a nail: a bore, or in a nail a slot, two half bores and what lies between them.

    Attributes
    ----------
    axis
        Directed along drilling, in the part's frame, through the point the part's file gives; of a slot that through
        its middle.
    diameter_mm
        Of the bore; of a slot its width.
    chamfer_mm
        Depth to which both rims are countersunk at 45 degrees, under the part's widest place (of a hole that leans
        along the nail: along its axis); None where nobody says.
    slot_length_mm
        Length of a slot's whole opening along the nail; None of a bore.
    """

    id: str
    axis: Line
    diameter_mm: float
    chamfer_mm: float | None = None
    slot_length_mm: float | None = None

    @property
    def half_slot_mm(self) -> float:
        """From a slot's middle to the axis of either half bore; 0 of a bore."""
        return 0.0 if self.slot_length_mm is None else 0.5 * (self.slot_length_mm - self.diameter_mm)

    @property
    def half_length_mm(self) -> float:
        """Half the length of the opening along the nail."""
        return 0.5 * self.diameter_mm + self.half_slot_mm

    @property
    def cosine_across_nail(self) -> float:
        """Cosine of the angle by which a nail's hole leans along the nail: 1 where it is square to the nail's axis."""
        return float(np.hypot(self.axis.direction[1], self.axis.direction[2]))

    def along_nail(self) -> NDArray[np.float64]:
        """Direction of a nail's slot: as near to the nail's x axis as it can be across the hole's, unit, shape (3,)."""
        direction = self.axis.direction
        return unit(np.array([1.0, 0.0, 0.0]) - direction[0] * direction)

    def beyond_slot(self, along_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Places along the nail, from a slot's middle, seen from the nearest axis that a drill may follow, same shape.

        Across the hole a slot is then as round as a bore.
        """
        return np.asarray(along_mm - np.clip(along_mm, -self.half_slot_mm, self.half_slot_mm))


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
    curvature_per_m
        Of the centre line of a nail that is bent in the canal (`shared/geometry/bend.py`); holes keep their place along
        it and in their cross-section. `Hole.axis` is that of the straight nail: see `hole_axis`.
    other_holes
        Further holes, which run in other directions and are not localised in the same image: images show them across
        or aslant, and what shows the nail has to know them.
    bone
        That it is made for; None where its file does not say.
    """

    material: Material
    diameter_mm: float
    cannulation_diameter_mm: float
    tip_x_mm: float
    holes: tuple[Hole, ...]
    sha256: str
    tolerance_mm: float | None = None
    tolerance_deg: float | None = None
    curvature_per_m: tuple[float, float] = (0.0, 0.0)
    other_holes: tuple[Hole, ...] = ()
    bone: Bone | None = None

    @property
    def all_holes(self) -> tuple[Hole, ...]:
        """Every hole that the nail has, localised or not."""
        return self.holes + self.other_holes

    @property
    def radius_mm(self) -> float:
        """Outer radius."""
        return 0.5 * self.diameter_mm

    @property
    def is_bent(self) -> bool:
        """Whether the centre line is an arc."""
        return self.curvature_per_m != (0.0, 0.0)

    def bent(self, curvature_per_m: tuple[float, float]) -> "NailPart":
        """The same nail with a curvature (1/m) towards y and z."""
        return self if curvature_per_m == self.curvature_per_m else replace(self, curvature_per_m=curvature_per_m)

    def section_of(self, hole: Hole) -> Transform[Nail, Nail]:
        """The motion that takes a hole of the straight nail to its place in the bent one."""
        x_mm = float(hole.axis.point_mm[0])
        back: Transform[Nail, Nail] = Transform.from_rotvec(np.zeros(3), np.array([-x_mm, 0.0, 0.0]))
        return section_frame(self.curvature_per_m, x_mm) @ back


def mean_hole_direction(part: NailPart | GuidePart) -> NDArray[np.float64]:
    """Mean direction of the localised holes' axes in the part's frame, unit, shape (3,)."""
    return unit(np.sum([hole.axis.direction for hole in part.holes], axis=0))


def across_holes(nail: NailPart) -> NDArray[np.float64]:
    """Directions across the localised holes' mean axis, the first as near to the nail's as can be, shape (2, 3).

    Of usual nails, whose holes run along z, these are x and y.
    """
    direction = mean_hole_direction(nail)
    first = unit(np.array([1.0, 0.0, 0.0]) - direction[0] * direction)
    return np.stack([first, np.cross(direction, first)])


def place_of_hole(nail: NailPart, hole: Hole) -> tuple[float, float]:
    """Where a hole's middle appears from along the holes: along the nail, and beside its axis, in mm."""
    along, beside = np.stack([[1.0, 0.0, 0.0], across_holes(nail)[1]]) @ hole.axis.point_mm
    return float(along), float(beside)


def hole_axis(nail: NailPart, hole: Hole) -> Line:
    """A hole's axis in the nail's frame, bent as the nail is."""
    if not nail.is_bent:
        return hole.axis
    section = nail.section_of(hole)
    return Line(section @ hole.axis.point_mm, section.directions(hole.axis.direction))


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
        entry, leave = crossings_of_cylinder(hole.axis, nail.radius_mm)
    except ValueError:
        raise ValueError(
            f"the axis of hole '{hole.id}' does not cross the nail of {nail.diameter_mm} mm diameter"
        ) from None
    if not nail.is_bent:
        return entry, leave
    section = nail.section_of(hole)
    return section @ entry, section @ leave


def crossings_of_cylinder(axis: Line, radius_mm: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where a line enters and leaves a cylinder about the x axis, shape (3,) each; raises `ValueError` if nowhere."""
    p, d = axis.point_mm[1:], axis.direction[1:]
    a, b, c = float(d @ d), float(p @ d), float(p @ p) - radius_mm**2
    if a == 0.0 or b * b <= a * c:
        raise ValueError(f"the line does not cross a cylinder of {radius_mm} mm radius")
    root = np.sqrt(b * b - a * c)
    near, far = (-b - root) / a, (-b + root) / a
    return axis.point_mm + near * axis.direction, axis.point_mm + far * axis.direction
