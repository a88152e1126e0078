"""Drills and wires through the guide's holes: how the guide yields, whether they pass the nail, and where they strike.

The rule: a drill of diameter d passes a hole of diameter h when its axis is off by at most (h - d) / 2 at the hole's
entry and at its exit. A drill pushes the guide sideways by its force over the robot's stiffness.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from shared.geometry.frames import Bone, Guide
from shared.geometry.lines import Line, angle_between_rad
from shared.geometry.parts import Hole, NailPart, hole_surface_points
from shared.geometry.transform import Transform
from simulation.scenario.values import Scenario
from simulation.world.poses import Rod, WorldState, bone_from_guide, mapped

Floats = NDArray[np.float64]
WIRE_DIAMETER_MM = 2.0
_OUTSIDE_MM = 60.0
_BEYOND_NAIL_MM = 28.0
_NM_TO_NMM = 1000.0


class Strike(StrEnum):
    """What a drill or a wire met that did not pass."""

    NOTHING = "nothing"
    NAIL_SURFACE = "nail_surface"
    BORE_WALL = "bore_wall"
    BESIDE_THE_NAIL = "beside_the_nail"


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """How a round tool went.

    Attributes
    ----------
    hole_id
        The guide hole it went through, and the nail hole it was meant for.
    passed
        Whether it went through the nail's hole.
    entry_offset_mm, exit_offset_mm, angle_deg
        Its axis against the nail hole's axis, at the hole's entry and exit.
    clearance_mm
        (h - d) / 2: the largest offset that passes.
    deflection_mm, deflection_deg
        How far the guide yielded.
    strike, strike_point_nail_mm
        What it met, and where its axis was then, in the nail's frame, shape (3,); None when it met nothing.
    rod
        The tool's path in the bone.
    """

    hole_id: str
    passed: bool
    entry_offset_mm: float
    exit_offset_mm: float
    angle_deg: float
    clearance_mm: float
    deflection_mm: float
    deflection_deg: float
    strike: Strike
    strike_point_nail_mm: Floats | None
    rod: Rod


class HoleUnknown(ValueError):
    """The guide, or the nail, has no hole of that name."""


def deflection(scenario: Scenario, hole: Hole, force_guide_n: Floats) -> Transform[Guide, Guide]:
    """How the locked robot yields to a sideways force at the guide hole's end next to the bone.

    Parameters
    ----------
    force_guide_n
        Shape (3,), in newtons, in the guide's frame.
    """
    stiffness, share = scenario.parts.hexapod.stiffness, scenario.drilling.stiffness_share
    shift_mm = force_guide_n / (stiffness.translation_n_per_mm * share)
    depth = max((b.centre_mm[2] + 0.5 * b.size_mm[2] for b in scenario.parts.guide.body), default=0.0)
    where_mm = hole.axis.at_plane(np.array([0.0, 0.0, depth]), np.array([0.0, 0.0, 1.0]))
    moment_nmm = np.cross(where_mm, force_guide_n)
    turn_deg = moment_nmm / (stiffness.rotation_nm_per_deg * _NM_TO_NMM * share)
    return Transform.from_rotvec(np.radians(turn_deg), shift_mm)


def drill_force_n(scenario: Scenario, number: int) -> Floats:
    """Sideways force of the case's n-th drilling, shape (3,), in the guide's frame."""
    generator = np.random.default_rng([scenario.seed, number, 0xD111])
    magnitude, direction = generator.uniform(*scenario.drilling.force_n), generator.uniform(-np.pi, np.pi)
    return magnitude * np.array([np.cos(direction), np.sin(direction), 0.0])


def drill(scenario: Scenario, state: WorldState, hole_id: str, force_guide_n: Floats) -> Passage:
    """Drill through a hole of the guide; raises `HoleUnknown`."""
    return _pass_through(scenario, state, hole_id, scenario.drilling.diameter_mm, force_guide_n)


def insert_wire(scenario: Scenario, state: WorldState, hole_id: str) -> Passage:
    """Push a K-wire through a hole of the guide, without force; raises `HoleUnknown`."""
    return _pass_through(scenario, state, hole_id, WIRE_DIAMETER_MM, np.zeros(3))


def _hole(holes: tuple[Hole, ...], hole_id: str, owner: str) -> Hole:
    for hole in holes:
        if hole.id == hole_id:
            return hole
    known = ", ".join(f"'{h.id}'" for h in holes)
    raise HoleUnknown(f"the {owner} has no hole '{hole_id}'; its holes are {known}")


def _pass_through(
    scenario: Scenario, state: WorldState, hole_id: str, diameter_mm: float, force_guide_n: Floats
) -> Passage:
    guide_hole = _hole(scenario.parts.guide.holes, hole_id, "guide")
    nail_hole = _hole(scenario.parts.nail.holes, hole_id, "nail")
    yielding = deflection(scenario, guide_hole, force_guide_n)
    bone_from_pushed: Transform[Bone, Guide] = bone_from_guide(scenario, state) @ yielding
    axis_bone = mapped(bone_from_pushed, guide_hole.axis)
    axis_nail = mapped(scenario.placement.bone_from_nail.inverse(), axis_bone)
    met = _meeting(scenario.parts.nail, nail_hole, axis_nail, diameter_mm)
    if not state.nail_present:
        met = _Meeting(met.entry_offset_mm, met.exit_offset_mm, met.clearance_mm, Strike.BESIDE_THE_NAIL, None)
    return Passage(
        hole_id=hole_id,
        passed=met.strike is Strike.NOTHING,
        entry_offset_mm=met.entry_offset_mm,
        exit_offset_mm=met.exit_offset_mm,
        angle_deg=float(np.degrees(angle_between_rad(nail_hole.axis.direction, axis_nail.direction))),
        clearance_mm=met.clearance_mm,
        deflection_mm=float(np.linalg.norm(yielding.translation_mm)),
        deflection_deg=float(np.degrees(np.linalg.norm(yielding.rotation_vector_rad))),
        strike=met.strike,
        strike_point_nail_mm=met.strike_point_nail_mm,
        rod=Rod(hole_id, axis_bone, -_OUTSIDE_MM, _end_mm(scenario, axis_bone, met), diameter_mm),
    )


def _end_mm(scenario: Scenario, axis_bone: Line, met: "_Meeting") -> float:
    """How far along its axis a tool gets: to what it strikes, or out of the bone's far side."""
    bone_from_nail = scenario.placement.bone_from_nail
    if met.strike_point_nail_mm is None:
        return float((bone_from_nail.translation_mm - axis_bone.point_mm) @ axis_bone.direction) + _BEYOND_NAIL_MM
    return float((bone_from_nail @ met.strike_point_nail_mm - axis_bone.point_mm) @ axis_bone.direction)


@dataclass(frozen=True, slots=True, eq=False)
class _Meeting:
    entry_offset_mm: float
    exit_offset_mm: float
    clearance_mm: float
    strike: Strike
    strike_point_nail_mm: Floats | None


def _meeting(nail: NailPart, hole: Hole, axis_nail: Line, diameter_mm: float) -> _Meeting:
    """Apply the rule to an axis in the nail's frame."""
    entry, leave = hole_surface_points(nail, hole)
    at_entry = axis_nail.at_plane(entry, hole.axis.direction)
    at_exit = axis_nail.at_plane(leave, hole.axis.direction)
    first, last = at_entry - entry, at_exit - leave
    clearance = 0.5 * (hole.diameter_mm - diameter_mm)
    offsets = float(np.linalg.norm(first)), float(np.linalg.norm(last))
    first, last = _beside_slot(hole, first), _beside_slot(hole, last)
    if max(float(np.linalg.norm(first)), float(np.linalg.norm(last))) <= clearance:
        return _Meeting(*offsets, clearance, Strike.NOTHING, None)
    if _misses(nail, axis_nail, diameter_mm):
        return _Meeting(*offsets, clearance, Strike.BESIDE_THE_NAIL, None)
    if float(np.linalg.norm(first)) > clearance:
        return _Meeting(*offsets, clearance, Strike.NAIL_SURFACE, at_entry)
    share = _share_where_reaches(first, last, clearance)
    return _Meeting(*offsets, clearance, Strike.BORE_WALL, at_entry + share * (at_exit - at_entry))


def _beside_slot(hole: Hole, offset_mm: Floats) -> Floats:
    """An offset from a hole's axis as one from the nearest axis within a slot."""
    along = hole.along_nail()
    free_mm = float(np.clip(offset_mm @ along, -hole.half_slot_mm, hole.half_slot_mm))
    return np.asarray(offset_mm - free_mm * along)


def _misses(nail: NailPart, axis_nail: Line, diameter_mm: float) -> bool:
    """Whether a tool passes beside the nail's round bar, or beyond its tip."""
    across = np.cross(axis_nail.direction, [1.0, 0.0, 0.0])
    apart = abs(float(axis_nail.point_mm @ across)) / float(np.linalg.norm(across))
    along = -float(
        axis_nail.point_mm[1:] @ axis_nail.direction[1:] / (axis_nail.direction[1:] @ axis_nail.direction[1:])
    )
    nearest_x = float(axis_nail.point_mm[0] + along * axis_nail.direction[0])
    radius = 0.5 * diameter_mm
    return apart >= nail.radius_mm + radius or nearest_x >= nail.tip_x_mm + radius


def _share_where_reaches(first: Floats, last: Floats, limit: float) -> float:
    """Share of the way from offset `first` to `last`, linear between them, at which its length reaches the limit."""
    step = last - first
    a, b, c = float(step @ step), float(first @ step), float(first @ first) - limit * limit
    return float((-b + np.sqrt(b * b - a * c)) / a)
