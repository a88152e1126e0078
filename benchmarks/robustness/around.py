"""The hole about which a foreign object is placed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.robustness.objects import axes_across
from shared.geometry.lines import unit
from simulation.scenario.values import Scenario
from simulation.world.poses import World

Floats = NDArray[np.float64]
_RIM_POINTS, _INSIDE_RIM = 90, 0.85


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """The hole about which an object is placed, in the beam's frame.

    Attributes
    ----------
    middle_mm, axis, along_nail
        The hole's middle and unit vectors along its axis (of drilling) and the nail's axis (distal), shape (3,) each.
    others_mm
        Middles of the other holes, shape (N, 3).
    rim_mm, nail_mm
        Radius of the rim, and of the nail.
    """

    middle_mm: Floats
    axis: Floats
    along_nail: Floats
    others_mm: Floats
    rim_mm: float
    nail_mm: float

    @staticmethod
    def of(scenario: Scenario, world: World, hole: int) -> "Around":
        """Around the hole with a number."""
        nail, pose = scenario.parts.nail, world.beam_from_nail
        one = nail.holes[hole]
        axes = pose.directions(np.array([one.axis.direction, [1.0, 0.0, 0.0]]))
        others = pose @ np.array([h.axis.point_mm for h in nail.holes if h is not one]).reshape(-1, 3)
        return Around(pose @ one.axis.point_mm, axes[0], axes[1], others, 0.5 * one.diameter_mm, nail.radius_mm)

    @property
    def ray(self) -> Floats:
        """Unit vector of the beam through the hole's middle."""
        return unit(self.middle_mm)

    def inside_rim(self) -> Floats:
        """Points of the hole next to its rim, at half its depth, shape (N, 3)."""
        first, second = axes_across(self.axis, 0.0)
        angle = np.linspace(0.0, 2.0 * np.pi, _RIM_POINTS, endpoint=False)[:, None]
        circle = np.cos(angle) * first + np.sin(angle) * second
        return np.asarray(self.middle_mm + _INSIDE_RIM * self.rim_mm * circle)

    def at_depth(self, point_mm: Floats, depth_mm: float) -> Floats:
        """The point moved along its ray by a depth: its shadow stays."""
        return point_mm * (1.0 + depth_mm / np.linalg.norm(point_mm))

    def turn_that_leaves_others_free(self, generator: np.random.Generator, offset_mm: float) -> float:
        """A random direction across the ray, in radians: a shadow that begins at the offset covers no other hole."""
        while True:
            turn = float(generator.uniform(0.0, 2.0 * np.pi))
            inwards, _ = axes_across(self.ray, turn)
            if np.all((self.others_mm - self.middle_mm) @ inwards < offset_mm - 1.3 * self.rim_mm):
                return turn
