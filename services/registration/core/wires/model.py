"""Prior of a K-wire before any image is evaluated: it passes through a hole of the guide, with play."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.drill_clearance import across_basis
from services.registration.core.tuning import WIRE_PRIOR
from shared.geometry.frames import Guide, Nail
from shared.geometry.lines import Line, read_only, unit
from shared.geometry.parts import GuidePart, Hole, NailPart, hole_surface_points
from shared.geometry.transform import Transform

# Unknowns of a wire: four offsets, then the start and the tip along the guide hole's axis.
WIRE_UNKNOWNS = 6
START, TIP = 4, 5


@dataclass(frozen=True, slots=True, eq=False)
class NailPassage:
    """Where a wire can pass the nail's near surface, by its offset across the guide hole's axis at the nail."""

    hole_mm: NDArray[np.float64]  # centre of the nail's hole, shape (2,)
    clearance_mm: float  # distance from there at which a wire still enters the hole
    across_nail: NDArray[np.float64]  # unit direction across the nail's axis, shape (2,)
    beside_mm: float  # distance from the nail's axis at which a wire passes beside the nail

    def interference_mm(self, offset_mm: NDArray[np.float64]) -> float:
        """Least shift that lets a wire at an offset, shape (2,), pass; 0 when it passes."""
        away = offset_mm - self.hole_mm
        outside_hole = float(np.linalg.norm(away)) - self.clearance_mm
        over_nail = self.beside_mm - abs(float(away @ self.across_nail))
        return max(min(outside_hole, over_nail), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class WireModel:
    """A wire's unknowns and their prior.

    The unknowns are the offset of the wire's axis across the guide hole's at the point that the guide's file gives
    (two) and at the nail (two), and the wire's start and tip along the hole's axis; all in mm.
    """

    hole: Hole  # the guide hole it passes through
    radius_mm: float
    across: NDArray[np.float64]  # two unit directions across the hole's axis, shape (2, 3), in the guide's frame
    nail_along_mm: float  # the nail's place along the guide hole's axis
    # prior of the unknowns, shapes (6,) and (6, 6)
    mean: NDArray[np.float64]
    precision: NDArray[np.float64]
    tip_sd_mm: float  # standard deviation of the tip's place along the hole's axis
    passage: NailPassage | None  # where it has passed the nail; None for a wire that met it
    latest_start_mm: float  # along the hole's axis: a wire starts on the surgeon's side of the guide's body

    def points_guide_mm(self, unknowns: NDArray[np.float64], count: int) -> NDArray[np.float64]:
        """Points along the axes of wires, unknowns of shape (B, 6), from start to tip, shape (B, count, 3)."""
        fraction_of_wire = np.linspace(0.0, 1.0, count)
        along = unknowns[:, START, None] * (1.0 - fraction_of_wire) + unknowns[:, TIP, None] * fraction_of_wire
        fraction = (along / self.nail_along_mm)[..., None]
        offset = (1.0 - fraction) * unknowns[:, None, 0:2] + fraction * unknowns[:, None, 2:4]
        axis = self.hole.axis
        return np.asarray(axis.point_mm + along[..., None] * axis.direction + offset @ self.across)

    def ends_guide_mm(self, offsets_mm: NDArray[np.float64], ends_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Both ends of a wire's axis, from the four offsets and the start and tip along the hole's axis, (2, 3)."""
        return np.asarray(self.points_guide_mm(np.concatenate([offsets_mm, ends_mm])[None], 2)[0])

    def line_guide(self, offsets_mm: NDArray[np.float64]) -> Line:
        """The wire's axis in the guide's frame, from the four offsets, shape (4,)."""
        start = self.hole.axis.point_mm + offsets_mm[0:2] @ self.across
        slope = (offsets_mm[2:4] - offsets_mm[0:2]) / self.nail_along_mm
        return Line(start, self.hole.axis.direction + slope @ self.across)


def wire_models(
    guide: GuidePart,
    guide_hole: Hole,
    nail: NailPart,
    guide_from_nail: Transform[Guide, Nail],
    wire_diameter_mm: float,
) -> tuple[WireModel, ...]:
    """Priors of a wire through a guide hole towards the nail hole of the same id: it met the nail, or it passed."""
    nail_hole = next(hole for hole in nail.holes if hole.id == guide_hole.id)
    axis = guide_hole.axis
    entry_mm = guide_from_nail @ hole_surface_points(nail, nail_hole)[0] - axis.point_mm
    across = across_basis(axis.direction)
    across_nail = across @ np.cross(axis.direction, guide_from_nail.directions(np.array([1.0, 0.0, 0.0])))
    passage = NailPassage(
        hole_mm=read_only(across @ entry_mm),
        clearance_mm=0.5 * (nail_hole.diameter_mm - wire_diameter_mm),
        across_nail=read_only(unit(across_nail)),
        beside_mm=nail.radius_mm + 0.5 * wire_diameter_mm,
    )
    nail_along_mm = float(entry_mm @ axis.direction)
    return tuple(wire_model(guide, guide_hole, wire_diameter_mm, nail_along_mm, way) for way in (None, passage))


def wire_model(
    guide: GuidePart, hole: Hole, wire_diameter_mm: float, nail_along_mm: float, passage: NailPassage | None
) -> WireModel:
    """Prior of a wire through a guide hole.

    At both ends of the bore the wire may lie anywhere that its diameter allows, equally likely: a standard deviation
    per axis of half the play's radius. It protrudes from the guide on the surgeon's side.

    A wire that met the nail ends at its near surface, or somewhat before; one that passed ends anywhere up to the far
    cortex. In a lateral image the tip's place along the wire and the wire's place across the image are determined by
    the same edge, so it matters which it was.
    """
    ends_mm = _bore_ends_mm(guide, hole)
    play_sd_mm = max(0.25 * (hole.diameter_mm - wire_diameter_mm), WIRE_PRIOR.least_play_sd_mm)
    precision = np.zeros((WIRE_UNKNOWNS, WIRE_UNKNOWNS))
    for along_mm in ends_mm:
        share = np.array([1.0 - along_mm / nail_along_mm, along_mm / nail_along_mm])
        precision[:4, :4] += np.kron(np.outer(share, share), np.eye(2)) / play_sd_mm**2
    past_mm, tip_sd_mm = 0.0, WIRE_PRIOR.stopped_tip_sd_mm
    if passage is not None:
        past_mm, tip_sd_mm = WIRE_PRIOR.passed_tip_mm, WIRE_PRIOR.passed_tip_sd_mm
    precision[START, START], precision[TIP, TIP] = WIRE_PRIOR.protrusion_sd_mm**-2, tip_sd_mm**-2
    start_mm, tip_mm = ends_mm[0] - WIRE_PRIOR.protrusion_mm, nail_along_mm + past_mm
    return WireModel(
        hole=hole,
        radius_mm=0.5 * wire_diameter_mm,
        across=read_only(across_basis(hole.axis.direction)),
        nail_along_mm=nail_along_mm,
        mean=read_only(np.array([0.0, 0.0, 0.0, 0.0, start_mm, tip_mm])),
        precision=read_only(precision),
        tip_sd_mm=tip_sd_mm,
        passage=passage,
        latest_start_mm=ends_mm[0],
    )


def _bore_ends_mm(guide: GuidePart, hole: Hole) -> tuple[float, float]:
    """Where a guide hole enters and leaves the guide's body, along its axis from the point in the guide's file."""
    ends: list[float] = []
    for box in guide.body:
        middle = float((np.array(box.centre_mm) - hole.axis.point_mm) @ hole.axis.direction)
        reach = float(0.5 * np.array(box.size_mm) @ np.abs(hole.axis.direction))
        ends += [middle - reach, middle + reach]
    half_length_mm = WIRE_PRIOR.bore_half_length_mm
    return (min(ends), max(ends)) if ends else (-half_length_mm, half_length_mm)
