"""Moves of the platform: all six axes together on a straight line in X Y Z U V W. Pure."""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from shared.geometry.hexapod import SpeedLimits
from simulation.controller.motion_profile import Profile, Progress, rest_to_rest, to_rest

RAMP_S = 0.1
Vector = NDArray[np.float64]


class Purpose(StrEnum):
    """Why the platform moves."""

    TARGET = "target"
    REFERENCE = "reference"
    STOP = "stop"


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """A move under way.

    Attributes
    ----------
    start, way
        X Y Z (mm) and U V W (degrees), shape (6,): where it began, and the whole way.
    deceleration_per_s2
        With which it comes to rest when halted, in shares of the way.
    """

    start: Vector
    way: Vector
    profile: Profile
    deceleration_per_s2: float
    purpose: Purpose
    elapsed_s: float = 0.0

    @property
    def progress(self) -> Progress:
        """Where it stands."""
        return self.profile.at(self.elapsed_s)

    @property
    def pose(self) -> Vector:
        """Pose now, shape (6,)."""
        return self.start + self.progress.share * self.way

    @property
    def left_s(self) -> float:
        """Time until rest."""
        return max(self.profile.duration_s - self.elapsed_s, 0.0)

    @property
    def resting_pose(self) -> Vector:
        """Pose at its end, shape (6,)."""
        return self.start + self.profile.at(self.profile.duration_s).share * self.way

    def later(self, dt_s: float) -> "Move":
        """The same move after some time."""
        return replace(self, elapsed_s=self.elapsed_s + dt_s)


def move_between(
    start: Vector, end: Vector, limits: SpeedLimits, velocity_mm_per_s: float, purpose: Purpose
) -> Move | None:
    """A move from rest to rest, or None when start and end are the same.

    Parameters
    ----------
    start, end
        X Y Z (mm) and U V W (degrees), shape (6,).
    velocity_mm_per_s
        System velocity: bounds the translation. The rotation keeps to its own limit; both start and end together.
    """
    way = end - start
    seconds = max(
        float(np.linalg.norm(way[:3])) / velocity_mm_per_s, float(np.linalg.norm(way[3:])) / limits.rotation_deg_per_s
    )
    if seconds < 1e-9:
        return None
    return Move(start, way, rest_to_rest(1.0 / seconds, RAMP_S), 1.0 / (seconds * RAMP_S), purpose)


def stopping(move: Move) -> Move:
    """Come to rest smoothly, within `RAMP_S`, on the line of a move; a move that does so already just goes on."""
    profile = to_rest(move.progress.speed_per_s, move.deceleration_per_s2)
    return Move(move.pose, move.way, profile, move.deceleration_per_s2, Purpose.STOP)
