"""A nail that bends: its centreline, the axis of each hole at its own place, and its shapes for the ray tracer.

Also a straight nail with another tip.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shared.geometry.frames import Nail
from shared.geometry.lines import Line, angle_between_rad
from shared.geometry.parts import Hole, NailPart, hole_surface_points
from shared.geometry.transform import Transform
from simulation.render import tracer
from simulation.render.rows import Shapes, bar_row, ellipsoid_row, joined
from simulation.render.scene import NAIL_LENGTH_MM, hole_shapes
from simulation.render.tracer import PackedScene
from simulation.render.truth import HoleTruth
from simulation.scenario.frames import Beam
from simulation.world.poses import World

Floats = NDArray[np.float64]
_X = np.array([1.0, 0.0, 0.0])
# How far a straight piece may be off the arc.
_SAGITTA_MM = 0.005
_BAR_END = 9  # column of a bar's row


@dataclass(frozen=True, slots=True)
class Bend:
    """Constant curvature of a nail's distal end.

    The nail's frame is that of its file at the pivot, where the centreline has its point and its tangent; the straight
    nail is laid onto the arc by length, and each cross-section stays plane and square to the centreline.

    Attributes
    ----------
    radius_mm
        Of the centreline.
    direction_rad
        To which side it bends distally, about the nail's x axis from y towards z.
    start_mm
        Where the curvature begins, as a length along the nail (x of the straight nail); it lasts up to the tip.
    pivot_mm
        The place whose frame stays; not before the start.
    """

    radius_mm: float
    direction_rad: float
    start_mm: float
    pivot_mm: float = 0.0

    def frame_at(self, x_mm: float) -> Transform[Nail, Nail]:
        """Nail from the straight nail's cross-section at x, whose middle is the origin."""
        sideways = np.array([0.0, np.cos(self.direction_rad), np.sin(self.direction_rad)])
        angle = (max(x_mm, self.start_mm) - self.pivot_mm) / self.radius_mm
        along, aside = self.radius_mm * np.sin(angle), self.radius_mm * (1.0 - np.cos(angle))
        centre = (self.pivot_mm + along) * _X + aside * sideways
        tangent = np.cos(angle) * _X + np.sin(angle) * sideways
        centre = centre + min(x_mm - self.start_mm, 0.0) * tangent
        return Transform.from_rotvec(angle * np.cross(_X, sideways), centre)

    def pieces(self, end_mm: float) -> list[tuple[float, float]]:
        """Middle and half length of straight pieces from the start to an end, within 0.005 mm of the arc."""
        count = int(np.ceil((end_mm - self.start_mm) / np.sqrt(8.0 * self.radius_mm * _SAGITTA_MM)))
        half = 0.5 * (end_mm - self.start_mm) / count
        return [(self.start_mm + (2 * k + 1) * half, half) for k in range(count)]


def local_hole(hole: Hole) -> Hole:
    """The hole in the frame of its own cross-section."""
    return replace(hole, axis=Line(hole.axis.point_mm - hole.axis.point_mm[0] * _X, hole.axis.direction))


def bent_shapes(nail: NailPart, bend: Bend, beam_from_nail: Transform[Beam, Nail]) -> Shapes:
    """Bar, tip, cannulation and bores of the bent nail."""
    radius, tip = nail.radius_mm, nail.tip_x_mm
    bars = [(tracer.NAIL, row) for row in _tube_rows(bend, beam_from_nail, radius, tip - radius)]
    if nail.cannulation_diameter_mm > 0.0:
        canal = _tube_rows(bend, beam_from_nail, 0.5 * nail.cannulation_diameter_mm, tip + 1.0)
        bars += [(tracer.NAIL_VOID, row) for row in canal]
    holes = []
    for hole in nail.holes:
        pose = beam_from_nail @ bend.frame_at(float(hole.axis.point_mm[0]))
        holes.append(hole_shapes(pose, local_hole(hole), radius))
    end = ellipsoid_row(beam_from_nail @ bend.frame_at(tip - radius), np.zeros(3), np.full(3, radius))
    return joined([Shapes(ellipsoids=((tracer.NAIL, end),), bars=tuple(bars)), *holes])


def _tube_rows(bend: Bend, beam_from_nail: Transform[Beam, Nail], radius_mm: float, end_mm: float) -> list[Floats]:
    """A straight bar and short pieces, each a little longer, so that no wedge stays open outside the bend."""
    axis = Line(np.zeros(3), _X)
    straight = beam_from_nail @ bend.frame_at(bend.start_mm)
    pieces = bend.pieces(end_mm)
    overlap = 1.1 * radius_mm * pieces[0][1] / bend.radius_mm
    rows = [bar_row(straight, axis, radius_mm, -NAIL_LENGTH_MM, overlap)]
    for middle, half in pieces:
        pose = beam_from_nail @ bend.frame_at(middle)
        rows.append(bar_row(pose, axis, radius_mm, -half - overlap, half + overlap))
    return rows


def with_bent_nail(packed: PackedScene, nail: NailPart, bend: Bend, world: World) -> PackedScene:
    """The scene with the bent nail in the straight one's place."""
    shapes = bent_shapes(nail, bend, world.beam_from_nail)
    bars = ~np.isin(packed.bar_class, (tracer.NAIL, tracer.NAIL_VOID))
    ellipsoids = packed.ellipsoid_class != tracer.NAIL
    return packed._replace(
        bars=np.concatenate([shapes.bar_rows(), packed.bars[bars]]),
        bar_class=np.concatenate([shapes.bar_classes(), packed.bar_class[bars]]),
        blocks=shapes.block_rows(),
        block_class=shapes.block_classes(),
        ellipsoids=np.concatenate([packed.ellipsoids[ellipsoids], shapes.ellipsoid_rows()]),
        ellipsoid_class=np.concatenate([packed.ellipsoid_class[ellipsoids], shapes.ellipsoid_classes()]),
    )


def with_tip(packed: PackedScene, nail: NailPart, depth_mm: float, world: World) -> PackedScene:
    """The scene with a tip of another depth, half an ellipsoid that ends where the file's tip does."""
    half_axes = np.array([depth_mm, nail.radius_mm, nail.radius_mm])
    end = ellipsoid_row(world.beam_from_nail, np.array([nail.tip_x_mm - depth_mm, 0.0, 0.0]), half_axes)
    bars, ellipsoids = packed.bars.copy(), packed.ellipsoids.copy()
    bars[packed.bar_class == tracer.NAIL, _BAR_END] = nail.tip_x_mm - depth_mm
    ellipsoids[packed.ellipsoid_class == tracer.NAIL] = end
    return packed._replace(bars=bars, ellipsoids=ellipsoids)


def bent_truths(nail: NailPart, bend: Bend, world: World) -> tuple[HoleTruth, ...]:
    """Each hole's own entry and axis, in the guide's frame."""
    return tuple(_truth(nail, bend, world, hole) for hole in nail.holes)


def _truth(nail: NailPart, bend: Bend, world: World, hole: Hole) -> HoleTruth:
    nail_from_section = bend.frame_at(float(hole.axis.point_mm[0]))
    entry, leave = hole_surface_points(nail, local_hole(hole))
    guide_from_section = world.guide_from_nail @ nail_from_section
    beam_from_section = world.beam_from_nail @ nail_from_section
    axis_beam = beam_from_section.directions(hole.axis.direction)
    tilt = np.degrees(angle_between_rad(axis_beam, beam_from_section @ (0.5 * (entry + leave))))
    axis_guide = guide_from_section.directions(hole.axis.direction)
    return HoleTruth(hole.id, guide_from_section @ entry, axis_guide, float(tilt))
