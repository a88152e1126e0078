"""Which move of the hexapod makes the guide's hole axes coincide with the nail's, within reach and by the least travel.

The move is found in the guide's own frame as `guide_from_target_guide`: where the guide has to be, seen from where it
is. Along the drilling axis (and, for a single hole, about it) the guide may be anywhere: that freedom is used only when
the hexapod cannot make the shortest move.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import (
    OUT_OF_REACH,
    RESIDUAL,
    UNKNOWN_HOLE,
    UNKNOWN_UNCERTAINTY,
    PlanRefusal,
)
from services.registration.core.drill_clearance import AxisOffset, angle_deg, axis_offset_mm
from services.registration.core.hole_axes import HoleEstimate
from services.registration.core.tuning import PLAN_SEARCH
from shared.acceptance import Refusal
from shared.errors import Accepted
from shared.geometry.frames import Guide
from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top, leg_lengths_mm, platform_pose
from shared.geometry.hexapod_accuracy import MOVE_SD_DEG, MOVE_SD_MM
from shared.geometry.hexapod_limits import limit_margins, path_violations
from shared.geometry.lines import Line, angle_between_rad, rotations_between_rad
from shared.geometry.parts import GuidePart
from shared.geometry.transform import Transform

# Guards of the motion that lays axes upon axes.
_ITERATIONS = 25
_STEP = 1e-5
_CONVERGED = 1e-10
_LEAST_SINGULAR_RATIO = 1e-4
_PARALLEL_RAD = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class RobotNow:
    """The hexapod as it stood when the image was taken."""

    hexapod: HexapodPart
    pose: PlatformPose
    pivot_mm: NDArray[np.float64]  # centre of rotation in the top's frame, shape (3,)
    head_extension_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class PredictedHole:
    """What remains at one hole after the move."""

    id: str
    offset: AxisOffset
    angle_deg: float
    chance_after_move: float


@dataclass(frozen=True, slots=True, eq=False)
class PlannedMove:
    """A move of the platform."""

    guide_from_target_guide: Transform[Guide, Guide]
    target_pose: PlatformPose
    leg_lengths_mm: NDArray[np.float64]  # at the target, shape (6,)
    # displacement of the guide's middle and rotation of the guide
    travel_mm: float
    travel_deg: float
    axial_shift_mm: float  # free travel along the drilling axis that was used to stay in reach
    predicted: tuple[PredictedHole, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Aim:
    """A nail hole, and the guide hole's axis that is to lie on its axis, both in the guide's present frame."""

    hole: HoleEstimate
    axis: Line

    def moved(self, move: Transform[Guide, Guide]) -> Line:
        """The guide hole's axis after a move of the guide."""
        return Line(move @ self.axis.point_mm, move.directions(self.axis.direction))

    def offset_mm(self, move: Transform[Guide, Guide]) -> NDArray[np.float64]:
        """Offset of the moved axis at the hole's entry and exit, shape (4,)."""
        hole = self.hole
        return axis_offset_mm(hole.axis_guide, self.moved(move), hole.entry_guide_mm, hole.exit_guide_mm)


@dataclass(frozen=True, slots=True, eq=False)
class _Freedom:
    """A use of the freedom along and about the drilling axis, and where the hexapod would stand."""

    shift_mm: float
    guide_from_target_guide: Transform[Guide, Guide]
    pose: PlatformPose


def plan_move(
    holes: tuple[HoleEstimate, ...], guide: GuidePart, hole_ids: tuple[str, ...], robot: RobotNow
) -> Accepted[PlannedMove] | Refusal[PlanRefusal]:
    """Plan the move after which the guide's holes of these names lie on the nail's axes.

    The holes are those of an accepted localisation; several when the guide's spacing equals the nail's.
    """
    aims = _aims(holes, guide, hole_ids)
    if isinstance(aims, Refusal):
        return aims
    shortest = _match_axes(aims)
    residual_mm = float(np.abs(_offsets(aims, shortest)).max())
    if not RESIDUAL.is_met(residual_mm):
        return RESIDUAL.refusal(
            f"guide and nail axes of {', '.join(hole_ids)} cannot coincide at once: {RESIDUAL.quoted(residual_mm)} "
            f"would remain{_askew(aims)}",
        )
    most_deg = PLAN_SEARCH.largest_turn_deg
    turns_deg = np.linspace(-most_deg, most_deg, PLAN_SEARCH.turns) if len(aims) == 1 else np.zeros(1)
    chosen = _within_reach(shortest, aims[0].hole.axis_guide, turns_deg, robot)
    return chosen if isinstance(chosen, Refusal) else Accepted(_planned(chosen, aims, robot))


def _aims(
    holes: tuple[HoleEstimate, ...], guide: GuidePart, hole_ids: tuple[str, ...]
) -> tuple[_Aim, ...] | Refusal[PlanRefusal]:
    nail_holes, guide_holes = {h.id: h for h in holes}, {h.id: h.axis for h in guide.holes}
    known = sorted(nail_holes.keys() & guide_holes.keys())
    unknown = [i for i in hole_ids if i not in known]
    if unknown or not hole_ids or len(set(hole_ids)) < len(hole_ids):
        what = f"hole '{unknown[0]}' is not" if unknown else "the list of holes is empty or names one twice; no hole is"
        return UNKNOWN_HOLE.refusal(f"{what} one of the holes that guide and nail share: {', '.join(known)}")
    if any(nail_holes[i].offset is None for i in hole_ids):
        return UNKNOWN_UNCERTAINTY.refusal()
    return tuple(_Aim(nail_holes[i], guide_holes[i]) for i in hole_ids)


def _askew(aims: tuple[_Aim, ...]) -> str:
    """How much farther from parallel the nail's axes are than the guide's, and the moves that meet them one by one."""
    first, last = aims[0], aims[-1]
    nail_deg = angle_deg(first.hole.axis_guide, last.hole.axis_guide)
    guide_deg = angle_deg(first.axis, last.axis)
    if abs(nail_deg - guide_deg) < PLAN_SEARCH.least_askew_deg:
        return ""
    moves = "; ".join(f"hole_ids ['{aim.hole.id}']" for aim in aims)
    return (
        f", because the nail is bent: its axes are {nail_deg:.1f}° apart and the guide's {guide_deg:.1f}°; plan one "
        f"move per hole: {moves}"
    )


def _within_reach(
    shortest: Transform[Guide, Guide], axis: Line, turns_deg: NDArray[np.float64], robot: RobotNow
) -> _Freedom | Refusal[PlanRefusal]:
    """The use of the freedom with the least travel that the hexapod can make, along the whole way."""
    most_mm = PLAN_SEARCH.longest_shift_mm
    shifts_mm = np.linspace(-most_mm, most_mm, PLAN_SEARCH.shifts)
    uses = sorted(product(shifts_mm, turns_deg), key=lambda use: abs(use[0]) + PLAN_SEARCH.mm_per_deg * abs(use[1]))
    tried: list[tuple[float, _Freedom]] = []
    for shift_mm, turn_deg in uses:
        freedom = _freedom(shortest, axis, float(shift_mm), float(turn_deg), robot)
        # how far inside the limits, in mm of the legs or degrees of the joints
        margin = min(map(float, limit_margins(robot.hexapod, freedom.pose.as_array(), robot.pivot_mm)))
        if margin >= 0.0 and not path_violations(robot.hexapod, robot.pose, freedom.pose, robot.pivot_mm):
            return freedom
        tried.append((margin, freedom))
    nearest = max(tried, key=lambda one: one[0])[1]
    return Refusal(OUT_OF_REACH.code, _out_of_reach(tried[0][1], nearest, robot))


def _out_of_reach(shortest: _Freedom, nearest: _Freedom, robot: RobotNow) -> str:
    violations, still = (
        [violation.message for violation in path_violations(robot.hexapod, robot.pose, one.pose, robot.pivot_mm)]
        for one in (shortest, nearest)
    )
    return (
        f"the hexapod cannot bring the guide onto the axes: {'; '.join(violations)}. With up to "
        f"{PLAN_SEARCH.longest_shift_mm:g} mm along the axis it comes nearest at {nearest.shift_mm:+.1f} mm, where "
        f"still {still[0]}"
    )


def _freedom(
    shortest: Transform[Guide, Guide], axis: Line, shift_mm: float, turn_deg: float, robot: RobotNow
) -> _Freedom:
    """Move the target along and about the nail's axis (given in the guide's frame)."""
    turn: Transform[Guide, Guide] = Transform.from_rotvec(np.radians(turn_deg) * axis.direction, np.zeros(3))
    shifted_mm = axis.point_mm - turn.rotation @ axis.point_mm + shift_mm * axis.direction
    along: Transform[Guide, Guide] = Transform.from_rotation_translation(turn.rotation, shifted_mm)
    move = along @ shortest
    top_from_guide = robot.hexapod.top_from_guide(robot.head_extension_mm)
    base_from_guide = base_from_top(robot.hexapod, robot.pose, robot.pivot_mm) @ top_from_guide
    pose = platform_pose(robot.hexapod, base_from_guide @ move @ top_from_guide.inverse(), robot.pivot_mm)
    return _Freedom(shift_mm, move, pose)


def _planned(chosen: _Freedom, aims: tuple[_Aim, ...], robot: RobotNow) -> PlannedMove:
    move = chosen.guide_from_target_guide
    return PlannedMove(
        guide_from_target_guide=move,
        target_pose=chosen.pose,
        leg_lengths_mm=leg_lengths_mm(robot.hexapod, chosen.pose.as_array(), robot.pivot_mm),
        travel_mm=float(np.linalg.norm(move.translation_mm)),
        travel_deg=float(np.degrees(np.linalg.norm(move.rotation_vector_rad))),
        axial_shift_mm=chosen.shift_mm,
        predicted=tuple(_predicted(aim, move) for aim in aims),
    )


def _predicted(aim: _Aim, move: Transform[Guide, Guide]) -> PredictedHole:
    """Bias of the move and uncertainty of localisation and robot, at one hole."""
    hole, after = aim.hole, aim.moved(move)
    assert hole.offset is not None  # checked in `_aims`
    lever_mm = float((hole.entry_guide_mm - after.point_mm) @ hole.axis_guide.direction)
    robot = _robot_covariance(np.array([lever_mm, lever_mm + hole.offset.length_mm]))
    offset = AxisOffset(aim.offset_mm(move), hole.offset.covariance_mm2 + robot, hole.offset.length_mm)
    return PredictedHole(hole.id, offset, angle_deg(hole.axis_guide, after), hole.clearance_probability(offset))


def _robot_covariance(levers_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Offsets at entry and exit that the robot's own errors make, shape (4, 4): a shift and a tilt about the guide."""
    tilt = np.radians(PLAN_SEARCH.tilt_share * MOVE_SD_DEG) ** 2 * np.outer(levers_mm, levers_mm)
    return np.asarray(np.kron(MOVE_SD_MM**2 + tilt, np.eye(2)))


def _match_axes(aims: tuple[_Aim, ...]) -> Transform[Guide, Guide]:
    """Least-squares motion of the guide after which its axes cross the nail's entries and exits.

    Gauss-Newton, from the smallest rotation that makes the mean directions coincide. What the axes leave free (travel
    along a common direction, rotation about a single axis) stays as small as it can.
    """
    start = np.sum([aim.axis.direction for aim in aims], axis=0)
    end = np.sum([aim.hole.axis_guide.direction for aim in aims], axis=0)
    move: Transform[Guide, Guide] = Transform.from_rotvec(rotations_between_rad(start, end), np.zeros(3))
    for _ in range(_ITERATIONS):
        residual = _offsets(aims, move)
        J = np.stack([(_offsets(aims, _nudged(move, d)) - residual) / _STEP for d in _STEP * np.eye(6)], axis=1)
        step, *_ = np.linalg.lstsq(J, -residual, rcond=_LEAST_SINGULAR_RATIO)
        move = _nudged(move, np.asarray(step, dtype=np.float64))
        if float(np.abs(step).max()) < _CONVERGED:
            break
    return _without_free_travel(move, aims)


def _offsets(aims: tuple[_Aim, ...], move: Transform[Guide, Guide]) -> NDArray[np.float64]:
    """Offsets in mm at entries and exits, shape (4 * number of aims,)."""
    return np.concatenate([aim.offset_mm(move) for aim in aims])


def _nudged(move: Transform[Guide, Guide], step: NDArray[np.float64]) -> Transform[Guide, Guide]:
    small: Transform[Guide, Guide] = Transform.from_rotvec(step[:3] / PLAN_SEARCH.lever_mm, step[3:])
    return move @ small


def _without_free_travel(move: Transform[Guide, Guide], aims: tuple[_Aim, ...]) -> Transform[Guide, Guide]:
    """Take back the guide's travel along the nail's axes, if they are parallel: it only costs reach."""
    along = aims[0].hole.axis_guide.direction
    if any(angle_between_rad(along, aim.hole.axis_guide.direction) > _PARALLEL_RAD for aim in aims):
        return move
    translation = move.translation_mm - along * float(along @ move.translation_mm)
    return Transform.from_rotation_translation(move.rotation, translation)
