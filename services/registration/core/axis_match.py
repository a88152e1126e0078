"""The rigid motion that lays axes of the guide upon axes of the nail."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from services.registration.core.drill_clearance import axis_offset_mm
from shared.geometry.frames import Guide
from shared.geometry.lines import Line, angle_between_rad
from shared.geometry.transform import Transform

_ITERATIONS = 25
_STEP = 1e-5
_CONVERGED = 1e-10
_LEAST_SINGULAR_RATIO = 1e-4
_PARALLEL_RAD = 1e-6
# One radian weighs as much as so many millimetres when the shortest motion is sought.
_LEVER_MM = 50.0


@dataclass(frozen=True, slots=True, eq=False)
class AxisPair:
    """A guide hole's axis and the nail hole's axis that it is to lie on, both in the guide's present frame.

    Attributes
    ----------
    entry_mm, exit_mm
        Of the nail hole, shape (3,): where coincidence counts.
    """

    axis: Line
    target: Line
    entry_mm: NDArray[np.float64]
    exit_mm: NDArray[np.float64]

    def moved(self, guide_from_target_guide: Transform[Guide, Guide]) -> Line:
        """The guide hole's axis after a move of the guide, in the guide's present frame."""
        return Line(
            guide_from_target_guide @ self.axis.point_mm, guide_from_target_guide.directions(self.axis.direction)
        )


def match_axes(pairs: tuple[AxisPair, ...]) -> Transform[Guide, Guide]:
    """Least-squares motion of the guide after which its axes cross the nail's entries and exits.

    Gauss-Newton from where the guide is. What the axes leave free (travel along a common direction, rotation about a
    single axis) stays as small as it can.

    Returns
    -------
    Transform
        `guide_from_target_guide`.
    """
    move: Transform[Guide, Guide] = Transform.from_rotation_translation(_first_rotation(pairs), np.zeros(3))
    for _ in range(_ITERATIONS):
        residual = _offsets(pairs, move)
        J = np.stack([(_offsets(pairs, _nudged(move, d)) - residual) / _STEP for d in _STEP * np.eye(6)], axis=1)
        step, *_ = np.linalg.lstsq(J, -residual, rcond=_LEAST_SINGULAR_RATIO)
        move = _nudged(move, np.asarray(step, dtype=np.float64))
        if float(np.abs(step).max()) < _CONVERGED:
            break
    return _without_free_travel(move, pairs)


def _first_rotation(pairs: tuple[AxisPair, ...]) -> NDArray[np.float64]:
    """Smallest rotation that takes the mean direction of the guide's axes to that of the nail's."""
    start = np.sum([p.axis.direction for p in pairs], axis=0)
    end = np.sum([p.target.direction for p in pairs], axis=0)
    normal = np.cross(start, end)
    sine = float(np.linalg.norm(normal))
    angle = np.arctan2(sine, float(start @ end))
    return np.asarray(Rotation.from_rotvec(normal * (angle / sine if sine > 0.0 else 0.0)).as_matrix())


def _offsets(pairs: tuple[AxisPair, ...], move: Transform[Guide, Guide]) -> NDArray[np.float64]:
    """Offsets in mm at entries and exits, shape (4 * number of pairs,)."""
    return np.concatenate([axis_offset_mm(p.target, p.moved(move), p.entry_mm, p.exit_mm) for p in pairs])


def _nudged(move: Transform[Guide, Guide], step: NDArray[np.float64]) -> Transform[Guide, Guide]:
    small: Transform[Guide, Guide] = Transform.from_rotvec(step[:3] / _LEVER_MM, step[3:])
    return move @ small


def _without_free_travel(move: Transform[Guide, Guide], pairs: tuple[AxisPair, ...]) -> Transform[Guide, Guide]:
    """Take back the guide's travel along the nail's axes, if they are parallel: it only costs reach."""
    along = pairs[0].target.direction
    if any(angle_between_rad(along, p.target.direction) > _PARALLEL_RAD for p in pairs):
        return move
    translation = move.translation_mm - along * float(along @ move.translation_mm)
    return Transform.from_rotation_translation(move.rotation, translation)
