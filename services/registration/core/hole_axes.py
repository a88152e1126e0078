"""Which of a nail's holes are localised, and their axes in the guide's frame with what is uncertain of them."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.c_arm_advice import hole_tilts
from services.registration.core.drill_clearance import AxisOffset, across_basis
from services.registration.core.tuning import HOLE_GROUPS, NAIL_AS_BUILT
from shared.geometry.bend import motion_by_curvature
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import Line, angle_between_rad, displacement_by_motion
from shared.geometry.parts import GuidePart, Hole, NailPart, hole_axis, hole_surface_points
from shared.geometry.transform import Transform


@dataclass(frozen=True, slots=True, eq=False)
class HoleEstimate:
    """One nail hole in the guide's frame."""

    id: str
    axis_guide: Line  # the hole's axis, directed along drilling, through its entry
    # Where the axis enters and leaves the nail, shape (3,)
    entry_guide_mm: NDArray[np.float64]
    exit_guide_mm: NDArray[np.float64]
    diameter_mm: float  # of the hole, from the nail's file
    drill_diameter_mm: float  # of the drill that is to pass it
    tilt_to_ray_deg: float  # angle between the axis and the ray through the hole's middle
    # error of the axis: mean zero, with its covariance; None when the method does not know its errors
    offset: AxisOffset | None

    @property
    def chance_along_estimate(self) -> float | None:
        """Probability that a drill along the estimated axis passes the true hole."""
        return None if self.offset is None else self.clearance_probability(self.offset)

    def clearance_probability(self, offset: AxisOffset) -> float:
        """Probability that a drill passes this hole whose axis is off by some offset."""
        return offset.clearance_probability(self.diameter_mm, self.drill_diameter_mm)


def holes_of_guide(nail: NailPart, guide: GuidePart) -> NailPart:
    """The nail with the holes that are localised for a guide; all others are `NailPart.other_holes`.

    An image shows holes of one direction only: that of the first hole that has a namesake in the guide, or of the first
    of all. The guide is mounted for it, and so its file decides, not the image.
    """
    named = {hole.id for hole in guide.holes}
    first = next((hole for hole in nail.holes if hole.id in named), nail.holes[0])

    def together(hole: Hole) -> bool:
        apart_deg = float(np.degrees(angle_between_rad(hole.axis.direction, first.axis.direction)))
        return apart_deg <= (HOLE_GROUPS.named_apart_deg if hole.id in named else HOLE_GROUPS.apart_deg)

    others = tuple(hole for hole in nail.holes if not together(hole))
    return replace(nail, holes=tuple(filter(together, nail.holes)), other_holes=nail.other_holes + others)


def holes_at(
    nail: NailPart,
    drill_diameter_mm: float,
    guide_from_nail: Transform[Guide, Nail],
    covariance: NDArray[np.float64] | None,
    camera_from_nail: Transform[Camera, Nail],
) -> tuple[HoleEstimate, ...]:
    """All holes of a nail in a known place, in the order of the nail's file.

    The covariance, shape (8, 8), is that of `guide_from_nail` and the nail's curvature (1/m), or None; tilts are those
    in the view `camera_from_nail`.
    """
    estimates = []
    for hole, tilt in zip(nail.holes, hole_tilts(camera_from_nail, nail), strict=True):
        entry, leaving = hole_surface_points(nail, hole)
        axis = Line(guide_from_nail @ entry, guide_from_nail.directions(hole_axis(nail, hole).direction))
        offset = None
        if covariance is not None:
            J = offsets_by_motion(nail, hole.id, guide_from_nail)
            length_mm = float(np.linalg.norm(leaving - entry))
            offset = AxisOffset(np.zeros(4), J @ covariance @ J.T + _as_built(nail, length_mm), length_mm)
        estimates.append(
            HoleEstimate(
                id=hole.id,
                axis_guide=axis,
                entry_guide_mm=axis.point_mm,
                exit_guide_mm=guide_from_nail @ leaving,
                diameter_mm=hole.diameter_mm,
                drill_diameter_mm=drill_diameter_mm,
                tilt_to_ray_deg=tilt.tilt_to_ray_deg,
                offset=offset,
            )
        )
    return tuple(estimates)


def rims_of(nail: NailPart, hole: Hole, angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points of the rims where a hole meets the nail's surface, at angles about its axis, shape (2, N, 3).

    The nail's surface is taken as flat across the axis; that of a slot runs about both its ends.
    """
    direction = hole_axis(nail, hole).direction
    circle = np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=1) @ across_basis(direction)
    rim = 0.5 * hole.diameter_mm * circle
    if hole.half_slot_mm > 0.0:
        along = nail.section_of(hole).directions(hole.along_nail())
        rim += hole.half_slot_mm * np.sign(circle @ along)[:, None] * along
    return np.stack([end + rim for end in hole_surface_points(nail, hole)])


def _as_built(nail: NailPart, length_mm: float) -> NDArray[np.float64]:
    """Covariance of a hole's own offset at entry and exit by the nail's tolerance, shape (4, 4).

    The pose fits all holes as they are: it takes up part of what they have in common.
    """
    place = NAIL_AS_BUILT.own_share * (nail.tolerance_mm or 0.0) ** 2
    turn = NAIL_AS_BUILT.own_share * (0.5 * length_mm * np.radians(nail.tolerance_deg or 0.0)) ** 2
    return np.kron(np.array([[place + turn, place - turn], [place - turn, place + turn]]), np.eye(2))


def offsets_by_motion(nail: NailPart, hole_id: str, guide_from_nail: Transform[Guide, Nail]) -> NDArray[np.float64]:
    """How a hole's axis moves across itself at entry and exit with the nail, shape (4, 8).

    By a small motion of the nail in its own frame and its curvature towards y and z (1/m).
    """
    hole = next(hole for hole in nail.holes if hole.id == hole_id)
    across = across_basis(guide_from_nail.directions(hole_axis(nail, hole).direction)) @ guide_from_nail.rotation
    ends = hole_surface_points(nail, hole)
    by_motion = np.vstack([across @ displacement_by_motion(end) for end in ends])
    bent_by = motion_by_curvature(nail.curvature_per_m, float(hole.axis.point_mm[0]))
    return np.hstack([by_motion, by_motion @ bent_by])
