"""Own scenes with parts that were built otherwise than their files say; part of docs/benchmarks/robustness.md.

usage: distalock bench built_parts [--kind NAME ...] [--count 20] [--seeds judged] [--rows FILE] [--images FOLDER]

The localisation gets the nominal files. The guide's frame stays that of its file, so that a displaced ball moves no
truth; each hole of the nail has its own true axis.
"""

import sys
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from benchmarks.robustness.command import RobustnessBench, run_bench
from benchmarks.robustness.kinds import Kind, first_line, rendered_kind
from benchmarks.robustness.scene import Drawn, RobustScene, generator_of, rendered, scene_of_shot
from benchmarks.scenes.changed_parts import (
    with_displaced_guide_balls,
    with_displaced_ring_balls,
    with_nail_holes,
    with_plates_nearer,
    with_scaled_guide,
)
from benchmarks.scenes.random_scenes import scene_of_seed
from shared.geometry.lines import Line
from simulation.scenario.values import Scenario
from simulation.world.poses import starting_state

Built = Callable[[Scenario, np.random.Generator], tuple[Scenario, Drawn]]
_BALLS_SD_MM = (0.05, 0.2)
_HOLE_SD_MM, _HOLE_SD_DEG = 0.05, 0.25


def guide_balls(scenario: Scenario, generator: np.random.Generator) -> tuple[Scenario, Drawn]:
    """The guide's balls displaced, with a standard deviation of 0.05 to 0.2 mm along each axis."""
    sd_mm = float(generator.uniform(*_BALLS_SD_MM))
    displacement = generator.normal(0.0, sd_mm, scenario.parts.guide.balls.position_mm.shape)
    return with_displaced_guide_balls(scenario, displacement), {"sd_mm": sd_mm}


def ring_balls(scenario: Scenario, generator: np.random.Generator) -> tuple[Scenario, Drawn]:
    """The ring's balls displaced, with a standard deviation of 0.05 to 0.2 mm along each axis."""
    sd_mm = float(generator.uniform(*_BALLS_SD_MM))
    displacement = generator.normal(0.0, sd_mm, scenario.parts.ring.balls.position_mm.shape)
    return with_displaced_ring_balls(scenario, displacement), {"sd_mm": sd_mm}


def guide_1_percent_larger(scenario: Scenario, _: np.random.Generator) -> tuple[Scenario, Drawn]:
    """The guide 1 % larger than its file: no single image shows it, a measured length does (decisions 21 and 36)."""
    return with_scaled_guide(scenario, 1.01), {"scale": 1.01}


def guide_3_percent_larger(scenario: Scenario, _: np.random.Generator) -> tuple[Scenario, Drawn]:
    """The guide 3 % larger than its file: no single image shows it either."""
    return with_scaled_guide(scenario, 1.03), {"scale": 1.03}


def ring_plates_nearer(scenario: Scenario, generator: np.random.Generator) -> tuple[Scenario, Drawn]:
    """The ring's plates 1 to 3 mm nearer to each other."""
    nearer_mm = float(generator.uniform(1.0, 3.0))
    return with_plates_nearer(scenario, nearer_mm), {"nearer_mm": nearer_mm}


def nail_tolerances(scenario: Scenario, generator: np.random.Generator) -> tuple[Scenario, Drawn]:
    """The nail's holes displaced along x and y (0.05 mm) and tilted about both (0.25 degrees), standard deviations."""

    def made(axis: Line) -> Line:
        shift = np.append(generator.normal(0.0, _HOLE_SD_MM, 2), 0.0)
        direction = axis.direction + np.append(np.tan(np.radians(generator.normal(0.0, _HOLE_SD_DEG, 2))), 0.0)
        return Line(axis.point_mm + shift, direction / np.linalg.norm(direction))

    return with_nail_holes(scenario, made), {"sd_mm": _HOLE_SD_MM, "sd_deg": _HOLE_SD_DEG}


def built_scene(built: Built, kind: str, seed: int) -> RobustScene:
    """The scene of a seed with parts as built."""
    scenario, drawn = built(scene_of_seed(seed), generator_of(kind, seed))
    shot = rendered(scenario, starting_state(scenario))
    return scene_of_shot(kind, scenario, shot, drawn, shot.truth.holes)


_BUILT: tuple[Built, ...] = (
    guide_balls,
    guide_1_percent_larger,
    guide_3_percent_larger,
    ring_balls,
    ring_plates_nearer,
    nail_tolerances,
)
KINDS: tuple[Kind, ...] = tuple(
    rendered_kind(partial(built_scene, built), built.__name__, first_line(built)) for built in _BUILT
)
BENCH = RobustnessBench("built_parts", "parts that were built otherwise than their files say", KINDS)


def main(arguments: Sequence[str] = ()) -> int:
    """Run the kinds of this benchmark."""
    return run_bench(BENCH, arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
