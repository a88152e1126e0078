"""Scenarios whose parts were made otherwise than their files say: rendered so, localised with the files."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shared.geometry.lines import Line, read_only
from shared.geometry.parts import BallPattern, Box, Hole, Plate
from simulation.scenario.values import Scenario

Floats = NDArray[np.float64]


def with_nail_holes(scenario: Scenario, changed: Callable[[Line], Line]) -> Scenario:
    """Other axes of the nail's holes."""
    return with_holes(scenario, (replace(hole, axis=changed(hole.axis)) for hole in scenario.parts.nail.holes))


def with_holes(scenario: Scenario, holes: Iterable[Hole]) -> Scenario:
    """Other holes of the nail."""
    nail = replace(scenario.parts.nail, holes=tuple(holes))
    return replace(scenario, parts=replace(scenario.parts, nail=nail))


def with_displaced_guide_balls(scenario: Scenario, displacement_mm: Floats) -> Scenario:
    """The guide's balls displaced, shape (N, 3)."""
    guide = scenario.parts.guide
    changed = replace(guide, balls=displaced(guide.balls, displacement_mm))
    return replace(scenario, parts=replace(scenario.parts, guide=changed))


def with_displaced_ring_balls(scenario: Scenario, displacement_mm: Floats) -> Scenario:
    """The ring's balls displaced, shape (N, 3)."""
    ring = scenario.parts.ring
    changed = replace(ring, balls=displaced(ring.balls, displacement_mm))
    return replace(scenario, parts=replace(scenario.parts, ring=changed))


def with_scaled_guide(scenario: Scenario, scale: float) -> Scenario:
    """The whole guide scaled about its origin, but for the diameters of balls and bores."""
    guide = scenario.parts.guide
    changed = replace(
        guide,
        balls=displaced(guide.balls, (scale - 1.0) * guide.balls.position_mm),
        holes=tuple(replace(hole, axis=Line(scale * hole.axis.point_mm, hole.axis.direction)) for hole in guide.holes),
        body=tuple(Box(_scaled(box.centre_mm, scale), _scaled(box.size_mm, scale)) for box in guide.body),
    )
    return replace(scenario, parts=replace(scenario.parts, guide=changed))


def with_plates_nearer(scenario: Scenario, nearer_mm: float) -> Scenario:
    """The ring's lower plate, with its balls, moved towards the one at z = 0."""
    ring = scenario.parts.ring
    lowest = min(plate.z_mm for plate in ring.plates)
    low = ring.balls.position_mm[:, 2] < 0.5 * lowest
    plates = tuple(
        Plate(plate.z_mm + nearer_mm * (plate.z_mm == lowest), plate.radius_mm, plate.thickness_mm)
        for plate in ring.plates
    )
    balls = displaced(ring.balls, np.outer(low, [0.0, 0.0, nearer_mm]))
    return replace(scenario, parts=replace(scenario.parts, ring=replace(ring, balls=balls, plates=plates)))


def displaced(balls: BallPattern, displacement_mm: Floats) -> BallPattern:
    """Balls elsewhere."""
    return replace(balls, position_mm=read_only(balls.position_mm + displacement_mm))


def _scaled(values: tuple[float, float, float], scale: float) -> tuple[float, float, float]:
    x, y, z = values
    return scale * x, scale * y, scale * z
