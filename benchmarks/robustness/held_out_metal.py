"""Metal in and on the leg from injuries and earlier operations: kinds that judge and fit nothing."""

import numpy as np
from numpy.typing import NDArray

from benchmarks.robustness.around import Around
from benchmarks.robustness.objects import Objects, axes_across, ball, rod, wire_along
from benchmarks.robustness.scene import Drawn
from shared.geometry.lines import unit

Floats = NDArray[np.float64]
_STAPLE_MM, _STAPLE_WIRE_MM = (7.0, 4.0), 0.55


def pellets(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """Eight to thirty steel pellets of 2 to 4.5 mm, as a shotgun leaves them: as large as balls of guide and ring."""
    count, diameter_mm = int(generator.integers(8, 31)), float(generator.uniform(2.0, 4.5))
    across, along = axes_across(around.ray, 0.0)
    rows: list[Floats] = []
    for _ in range(count):
        aside, depth_mm = generator.normal(0.0, 30.0, 2), float(generator.uniform(-60.0, 60.0))
        rows += ball(around.at_depth(around.middle_mm + aside[0] * across + aside[1] * along, depth_mm), diameter_mm)
    return Objects(rods=tuple(rows)), {"count": count, "diameter_mm": diameter_mm}


def skin_staples(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """Eight to sixteen staples along a closed wound that passes the hole within 12 mm."""
    count, turn = int(generator.integers(8, 17)), float(generator.uniform(0.0, 2.0 * np.pi))
    aside_mm, depth_mm = float(generator.uniform(-12.0, 12.0)), float(generator.uniform(-90.0, -50.0))
    across, along = axes_across(around.ray, turn)
    middle = around.at_depth(around.middle_mm + aside_mm * across, depth_mm)
    rows: list[Floats] = []
    for k in range(count):
        lean = float(generator.uniform(-0.3, 0.3))
        bar = np.cos(lean) * across + np.sin(lean) * along
        at = middle + 7.0 * (k - 0.5 * (count - 1)) * along
        ends = np.array([at - 0.5 * _STAPLE_MM[0] * bar, at + 0.5 * _STAPLE_MM[0] * bar])
        legs = ends + _STAPLE_MM[1] * around.ray
        rows += wire_along(np.array([legs[0], ends[0], ends[1], legs[1]]), _STAPLE_WIRE_MM)
    return Objects(rods=tuple(rows)), {"count": count, "aside_mm": aside_mm, "turn_rad": turn, "depth_mm": depth_mm}


def fixator_pins(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """Two pins of 4 to 6 mm of an external fixator; the shadow of the nearer one passes the hole at 1.5 to 6 radii."""
    diameter_mm, turn = float(generator.uniform(4.0, 6.0)), float(generator.uniform(0.0, 2.0 * np.pi))
    offset_mm, apart_mm = around.rim_mm * float(generator.uniform(1.5, 6.0)), float(generator.uniform(15.0, 40.0))
    lean = float(generator.uniform(-0.9, 0.9))
    across, along = axes_across(around.ray, turn)
    direction = np.cos(lean) * along + np.sin(lean) * around.ray
    tips = [
        around.at_depth(around.middle_mm + at * across, float(generator.uniform(-25.0, 25.0))) - 25.0 * direction
        for at in (offset_mm + 0.5 * diameter_mm, offset_mm + 0.5 * diameter_mm + apart_mm)
    ]
    rows = tuple(rod(tip, tip + 150.0 * direction, diameter_mm) for tip in tips)
    return Objects(rods=rows), {"diameter_mm": diameter_mm, "turn_rad": turn, "offset_mm": offset_mm, "lean_rad": lean}


def blocking_screw(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """A screw beside the nail, about along the beam, that keeps the nail in its place: a disc at the nail's edge."""
    side, along_mm = float(generator.choice([-1.0, 1.0])), float(generator.uniform(-15.0, 15.0))
    diameter_mm, tilt = float(generator.uniform(4.0, 5.0)), float(np.radians(generator.uniform(0.0, 15.0)))
    gap_mm = float(generator.uniform(0.0, 2.0))
    outwards = side * unit(np.cross(around.ray, around.along_nail))
    middle = around.middle_mm + along_mm * around.along_nail
    middle = middle + (around.nail_mm + 0.5 * diameter_mm + gap_mm) * outwards
    direction = unit(around.ray + np.tan(tilt) * axes_across(around.ray, float(generator.uniform(0.0, 6.28)))[0])
    rows = [rod(middle - 22.0 * direction, middle + 22.0 * direction, diameter_mm)]
    rows.append(rod(middle - 26.0 * direction, middle - 22.0 * direction, 8.0))
    drawn: Drawn = {"side": side, "along_mm": along_mm, "gap_mm": gap_mm, "tilt_rad": tilt, "diameter_mm": diameter_mm}
    return Objects(rods=tuple(rows)), drawn


def cerclage_wires(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """One to three loops of wire of 1 to 2 mm about the bone, the nearest within 8 mm of the hole's middle."""
    count, diameter_mm = int(generator.integers(1, 4)), float(generator.uniform(1.0, 2.0))
    first_mm, radius_mm = float(generator.uniform(-8.0, 8.0)), float(generator.uniform(14.0, 22.0))
    away = 1.0 if first_mm >= 0.0 else -1.0
    angle = np.linspace(0.0, 2.0 * np.pi, 37)[:, None]
    rows: list[Floats] = []
    for k in range(count):
        lean, turn = float(generator.uniform(-0.3, 0.3)), float(generator.uniform(0.0, 2.0 * np.pi))
        normal = unit(around.along_nail + np.tan(lean) * axes_across(around.along_nail, turn)[0])
        one, two = axes_across(normal, 0.0)
        middle = around.middle_mm + (first_mm + away * 12.0 * k) * around.along_nail
        rows += wire_along(middle + radius_mm * (np.cos(angle) * one + np.sin(angle) * two), diameter_mm)
    return Objects(rods=tuple(rows)), {"count": count, "diameter_mm": diameter_mm, "first_mm": first_mm}
