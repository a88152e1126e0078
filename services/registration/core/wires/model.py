"""What is known of a K-wire before any image is looked at: it passes through a hole of the guide, with play."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.drill_clearance import across_basis
from shared.geometry.lines import Line, read_only
from shared.geometry.parts import GuidePart, Hole

SHARED = 6
START, TIP = 4, 5
_STICKS_OUT_MM, _STICKS_OUT_SD_MM = 40.0, 25.0
_LEAST_PLAY_SD_MM = 0.05
_BORE_HALF_LENGTH_MM = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """Where a wire can get past the nail's near surface, by its offset across the guide hole's axis at the nail.

    Attributes
    ----------
    hole_mm
        Where the nail's hole is, shape (2,).
    clearance_mm
        How far from there a wire still enters the hole.
    across_nail
        Unit direction across the nail's axis, shape (2,).
    beside_mm
        How far from the nail's axis a wire passes beside the nail.
    """

    hole_mm: NDArray[np.float64]
    clearance_mm: float
    across_nail: NDArray[np.float64]
    beside_mm: float

    def missed_by_mm(self, offset_mm: NDArray[np.float64]) -> float:
        """How far a wire at an offset, shape (2,), is from getting past; 0 when it does."""
        away = offset_mm - self.hole_mm
        outside_hole = float(np.linalg.norm(away)) - self.clearance_mm
        over_nail = self.beside_mm - abs(float(away @ self.across_nail))
        return max(min(outside_hole, over_nail), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Ending:
    """One way a wire can end: how far past the nail's near surface, and how sure that is, in mm.

    A wire that met the nail ends at its surface, or somewhat before; one that passed ends anywhere up to the far
    cortex. Which it is matters: in a lateral image the place of a wire's tip along the wire and that of the wire
    across the image are told by the same edge.

    Attributes
    ----------
    passage
        Which wires can end so; None: any.
    """

    past_entry_mm: float
    sd_mm: float
    passage: Passage | None


def endings(passage: Passage) -> tuple[Ending, ...]:
    """The ways a wire can end."""
    return Ending(0.0, 6.0, None), Ending(30.0, 10.0, passage)


@dataclass(frozen=True, slots=True, eq=False)
class WireModel:
    """A wire's unknowns and their prior.

    The unknowns are: offset of the wire's axis across the guide hole's at the point that the guide's file gives (two)
    and at the nail (two), and where the wire begins and ends along the hole's axis; all in mm.

    Attributes
    ----------
    hole
        The guide hole it passes through.
    across
        Two unit directions across the hole's axis, shape (2, 3), in the guide's frame.
    nail_along_mm
        Where the nail is, along the guide hole's axis.
    mean, precision
        Prior of the unknowns, shapes (6,) and (6, 6).
    ending
        How the wire is taken to end.
    latest_start_mm
        Along the hole's axis: a wire begins on the surgeon's side of the guide's body.
    """

    hole: Hole
    radius_mm: float
    across: NDArray[np.float64]
    nail_along_mm: float
    mean: NDArray[np.float64]
    precision: NDArray[np.float64]
    ending: Ending
    latest_start_mm: float

    def points_guide_mm(self, unknowns: NDArray[np.float64], count: int) -> NDArray[np.float64]:
        """Points along the axis of wires, unknowns of shape (B, 6), from begin to end, shape (B, count, 3)."""
        way = np.linspace(0.0, 1.0, count)
        along = unknowns[:, START, None] * (1.0 - way) + unknowns[:, TIP, None] * way
        fraction = (along / self.nail_along_mm)[..., None]
        offset = (1.0 - fraction) * unknowns[:, None, 0:2] + fraction * unknowns[:, None, 2:4]
        axis = self.hole.axis
        return np.asarray(axis.point_mm + along[..., None] * axis.direction + offset @ self.across)

    def ends_guide_mm(self, offsets_mm: NDArray[np.float64], ends_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Both ends of a wire's axis, from the four offsets and where it begins and ends, shape (2, 3)."""
        return np.asarray(self.points_guide_mm(np.concatenate([offsets_mm, ends_mm])[None], 2)[0])

    def line_guide(self, offsets_mm: NDArray[np.float64]) -> Line:
        """The wire's axis in the guide's frame, from the four offsets, shape (4,)."""
        start = self.hole.axis.point_mm + offsets_mm[0:2] @ self.across
        slope = (offsets_mm[2:4] - offsets_mm[0:2]) / self.nail_along_mm
        return Line(start, self.hole.axis.direction + slope @ self.across)


def wire_model(
    guide: GuidePart, hole: Hole, wire_diameter_mm: float, nail_along_mm: float, ending: Ending
) -> WireModel:
    """Prior of a wire through a guide hole.

    At both ends of the bore the wire may lie anywhere that its diameter allows, equally likely: a standard deviation
    per axis of half the play's radius. It sticks out of the guide on the surgeon's side.
    """
    across = across_basis(hole.axis.direction)
    ends_mm = bore_ends_mm(guide, hole)
    play_sd_mm = max(0.25 * (hole.diameter_mm - wire_diameter_mm), _LEAST_PLAY_SD_MM)
    precision = np.zeros((SHARED, SHARED))
    for along_mm in ends_mm:
        fraction = along_mm / nail_along_mm
        for axis in range(2):
            row = np.zeros(SHARED)
            row[axis], row[2 + axis] = 1.0 - fraction, fraction
            precision += np.outer(row, row) / play_sd_mm**2
    precision[START, START], precision[TIP, TIP] = _STICKS_OUT_SD_MM**-2, ending.sd_mm**-2
    mean = np.array([0.0, 0.0, 0.0, 0.0, ends_mm[0] - _STICKS_OUT_MM, nail_along_mm + ending.past_entry_mm])
    return WireModel(
        hole,
        0.5 * wire_diameter_mm,
        read_only(across),
        nail_along_mm,
        read_only(mean),
        read_only(precision),
        ending,
        ends_mm[0],
    )


def bore_ends_mm(guide: GuidePart, hole: Hole) -> tuple[float, float]:
    """Where a guide hole enters and leaves the guide's body, along its axis from the point in the guide's file."""
    ends: list[float] = []
    for box in guide.body:
        middle = float((np.array(box.centre_mm) - hole.axis.point_mm) @ hole.axis.direction)
        reach = float(0.5 * np.array(box.size_mm) @ np.abs(hole.axis.direction))
        ends += [middle - reach, middle + reach]
    return (min(ends), max(ends)) if ends else (-_BORE_HALF_LENGTH_MM, _BORE_HALF_LENGTH_MM)
