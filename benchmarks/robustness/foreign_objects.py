"""Own scenes with things in the way of the beam; writes its part of docs/benchmarks/robustness.md.

usage: distalock bench foreign_objects [--kind NAME ...] [--count 20] [--seeds judged] [--rows FILE] [--images FOLDER]

Each object is drawn from its seed about one of the nail's holes and rendered with the scene.
"""

import sys
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.robustness.around import Around
from benchmarks.robustness.command import RobustnessBench, run_bench
from benchmarks.robustness.held_out import clamp, drill_over_rim, lead_letter
from benchmarks.robustness.held_out_metal import blocking_screw, cerclage_wires, fixator_pins, pellets, skin_staples
from benchmarks.robustness.hole_filling import drilled_bone, drilled_filling, filled_holes, half_filled_holes
from benchmarks.robustness.kinds import Kind, first_line, held_out, rendered_kind
from benchmarks.robustness.objects import (
    Objects,
    SteelBox,
    axes_across,
    plate_with_edge,
    rod,
    wire_along,
)
from benchmarks.robustness.scene import COVERED, Drawn, RobustScene, generator_of, rendered, scene_of_shot
from benchmarks.scenes.random_scenes import scene_of_seed
from shared.geometry.lines import unit
from simulation.scenario.values import Scenario
from simulation.world.poses import World, starting_state, world_at

Floats = NDArray[np.float64]


Draw = Callable[[Around, np.random.Generator], tuple[Objects, Drawn]]


def retractor(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """A blade whose straight edge covers 10 to 50 % of the rim."""
    covered = float(generator.uniform(0.1, 0.5))
    offset_mm = around.rim_mm * float(np.cos(np.pi * covered))
    turn = around.turn_that_leaves_others_free(generator, offset_mm)
    size = [generator.uniform(8.0, 40.0), generator.uniform(16.0, 120.0), generator.uniform(0.8, 2.5)]
    box, drawn = _edge_at(around, generator, turn, offset_mm, size)
    return Objects(boxes=(box,)), drawn | {"covered": covered}


def hammer(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """A block with a handle: its edge from a quarter over the rim to 10 mm beside it."""
    offset_mm = float(generator.uniform(0.7 * around.rim_mm, around.rim_mm + 10.0))
    turn = around.turn_that_leaves_others_free(generator, offset_mm)
    size = [generator.uniform(25.0, 35.0), generator.uniform(60.0, 90.0), generator.uniform(25.0, 35.0)]
    box, drawn = _edge_at(around, generator, turn, offset_mm, size)
    handle = rod(box.centre_mm, box.centre_mm + 200.0 * box.axes[0], 14.0)
    return Objects(boxes=(box,), rods=(handle,)), drawn


def _edge_at(
    around: Around, generator: np.random.Generator, turn_rad: float, offset_mm: float, size_mm: list[float]
) -> tuple[SteelBox, Drawn]:
    """A block whose shadow begins at an offset from the hole's middle, at a drawn depth and tilt."""
    inwards, _ = axes_across(around.ray, turn_rad)
    depth_mm, tilt = float(generator.uniform(-90.0, 60.0)), float(np.radians(generator.uniform(-25.0, 25.0)))
    edge = around.at_depth(around.middle_mm + offset_mm * inwards, depth_mm)
    box = plate_with_edge(edge, inwards, around.ray, size_mm, tilt)
    return box, {"turn_rad": turn_rad, "offset_mm": offset_mm, "depth_mm": depth_mm, "tilt_rad": tilt}


def screw_half_in(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """A screw that ends in the middle of the hole, a few degrees askew, in half of the scenes with a head."""
    tilt, turn = float(np.radians(generator.uniform(0.0, 6.0))), float(generator.uniform(0.0, 2.0 * np.pi))
    side, head = float(generator.choice([-1.0, 1.0])), float(generator.integers(2))
    outwards = side * unit(around.axis + np.tan(tilt) * axes_across(around.axis, turn)[0])
    length = float(generator.uniform(30.0, 60.0))
    thread = 2.0 * around.rim_mm - float(generator.uniform(0.2, 1.0))
    start = around.middle_mm
    rows = [rod(start, start + length * outwards, thread - 0.9)]
    ridges = np.arange(0.5, length, 1.75)
    rows += [rod(start + at * outwards, start + (at + 0.6) * outwards, thread) for at in ridges]
    if head:
        rows.append(rod(start + length * outwards, start + (length + 4.0) * outwards, 8.0))
    drawn: Drawn = {"tilt_rad": tilt, "turn_rad": turn, "side": side, "head": head, "thread_mm": thread}
    return Objects(rods=tuple(rows)), drawn


def wire_across_rim(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """A K-wire whose shadow crosses the rim."""
    turn, depth_mm = float(generator.uniform(0.0, 2.0 * np.pi)), float(generator.uniform(-60.0, 60.0))
    offset_mm = float(generator.uniform(0.2, 1.1)) * around.rim_mm
    lean, diameter = float(np.radians(generator.uniform(-25.0, 25.0))), float(generator.choice([1.6, 2.0, 2.5]))
    across, along = axes_across(around.ray, turn)
    direction = np.cos(lean) * along + np.sin(lean) * around.ray
    point = around.at_depth(around.middle_mm + offset_mm * across, depth_mm)
    before, after = generator.uniform(15.0, 120.0, 2)
    wire = rod(point - before * direction, point + after * direction, diameter)
    drawn: Drawn = {"turn_rad": turn, "offset_mm": offset_mm, "depth_mm": depth_mm, "diameter_mm": diameter}
    return Objects(rods=(wire,)), drawn


def plate_beside(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """A bone plate along the nail, its shadow's edge up to 8 mm beside the nail's."""
    gap_mm, side = float(generator.uniform(0.0, 8.0)), float(generator.choice([-1.0, 1.0]))
    inwards = side * unit(np.cross(around.ray, around.along_nail))
    size = [generator.uniform(12.0, 16.0), generator.uniform(80.0, 140.0), generator.uniform(3.0, 4.5)]
    return _plate_at(around, generator, inwards, around.nail_mm + gap_mm, size, {"gap_mm": gap_mm, "side": side})


def plate_over(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """A bone plate over the nail that ends 1 to 8 mm before the proximal rim."""
    gap_mm = float(generator.uniform(1.0, 8.0))
    inwards = -unit(around.along_nail - (around.along_nail @ around.ray) * around.ray)
    size = [generator.uniform(60.0, 100.0), generator.uniform(12.0, 16.0), generator.uniform(3.0, 4.5)]
    return _plate_at(around, generator, inwards, around.rim_mm + gap_mm, size, {"gap_mm": gap_mm})


def _plate_at(
    around: Around,
    generator: np.random.Generator,
    inwards: Floats,
    offset_mm: float,
    size_mm: list[float],
    drawn: Drawn,
) -> tuple[Objects, Drawn]:
    """A plate on the bone, turned by up to 10 degrees against the nail."""
    depth_mm, turn = (
        float(generator.choice([-1.0, 1.0]) * generator.uniform(18.0, 35.0)),
        generator.uniform(-0.17, 0.17),
    )
    turned = np.cos(turn) * inwards + np.sin(turn) * np.cross(around.ray, inwards)
    edge = around.at_depth(around.middle_mm + offset_mm * inwards, depth_mm)
    box = plate_with_edge(edge, turned, around.ray, size_mm, 0.0)
    return Objects(boxes=(box,)), drawn | {"depth_mm": depth_mm, "turn_rad": float(turn)}


def glove_wires(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """Eight to fourteen thin wires, slightly bent, across a patch about the hole."""
    count, diameter = int(generator.integers(8, 15)), float(generator.uniform(0.2, 0.35))
    rows: list[Floats] = []
    for _ in range(count):
        rows += _bent_wire(around, generator, diameter, length_mm=60.0, sway_mm=4.0, aside_mm=25.0)
    return Objects(rods=tuple(rows)), {"count": count, "diameter_mm": diameter}


def gauze_threads(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """One to three wavy threads; steel of 0.3 to 0.5 mm absorbs about as much as their barium sulphate."""
    count, diameter = int(generator.integers(1, 4)), float(generator.uniform(0.3, 0.5))
    rows: list[Floats] = []
    for _ in range(count):
        rows += _bent_wire(around, generator, diameter, length_mm=90.0, sway_mm=15.0, aside_mm=12.0)
    return Objects(rods=tuple(rows)), {"count": count, "diameter_mm": diameter}


def _bent_wire(
    around: Around,
    generator: np.random.Generator,
    diameter_mm: float,
    length_mm: float,
    sway_mm: float,
    aside_mm: float,
) -> tuple[Floats, ...]:
    """A wire in a plane across the ray: a line with two sines."""
    across, along = axes_across(around.ray, float(generator.uniform(0.0, 2.0 * np.pi)))
    at = np.linspace(-0.5 * length_mm, 0.5 * length_mm, 17)[:, None]
    phase, waves = generator.uniform(0.0, 2.0 * np.pi, 2), generator.uniform(0.5, 2.0, 2)
    sway = sum(0.5 * sway_mm * np.sin(2.0 * np.pi * w * at / length_mm + p) for p, w in zip(phase, waves, strict=True))
    aside, depth_mm = generator.uniform(-aside_mm, aside_mm), float(generator.uniform(-80.0, 50.0))
    middle = around.at_depth(around.middle_mm, depth_mm)
    return wire_along(middle + at * along + (aside + sway) * across, diameter_mm)


def other_leg(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """The other thigh between the tube and this one, its edge within 20 mm of the hole."""
    offset_mm, depth_mm = float(generator.uniform(-20.0, 20.0)), float(generator.uniform(-220.0, -140.0))
    side, half = float(generator.choice([-1.0, 1.0])), float(generator.uniform(55.0, 80.0))
    inwards = side * unit(np.cross(around.ray, around.along_nail))
    along = np.cross(inwards, around.ray)
    edge = around.at_depth(around.middle_mm + offset_mm * inwards, depth_mm)
    to_unit = np.diag([1.0 / half, 1.0 / 500.0, 1.0 / half]) @ np.array([inwards, along, around.ray])
    row = np.concatenate([edge + half * inwards, to_unit.ravel()])
    drawn: Drawn = {"offset_mm": offset_mm, "depth_mm": depth_mm, "side": side, "half_mm": half}
    return Objects(soft=(row,)), drawn


def cluttered_scene(draw: Draw, kind: str, seed: int) -> RobustScene:
    """The scene of a seed with an object about one of its holes."""
    scenario = scene_of_seed(seed)
    state = starting_state(scenario)
    objects, drawn = placed(draw, kind, scenario, world_at(scenario, state))
    shot = rendered(scenario, state, lambda packed, _: objects.added_to(packed))
    return scene_of_shot(kind, scenario, shot, drawn, shot.truth.holes)


def placed(draw: Draw, kind: str, scenario: Scenario, world: World) -> tuple[Objects, Drawn]:
    """An object about a drawn hole (a plate over the nail: about the proximal one), and how much it covers of each."""
    generator, holes = generator_of(kind, scenario.seed), scenario.parts.nail.holes
    number = int(generator.integers(len(holes)))
    if draw is plate_over:
        number = int(np.argmin([one.axis.point_mm[0] for one in holes]))
    around = [Around.of(scenario, world, k) for k in range(len(holes))]
    objects, drawn = draw(around[number], generator)
    named: Drawn = {"hole": holes[number].id}
    covered: Drawn = {
        COVERED + hole.id: objects.covered_share(one.inside_rim()) for hole, one in zip(holes, around, strict=True)
    }
    return objects, named | drawn | covered


DRAWS: tuple[Draw, ...] = (
    retractor,
    screw_half_in,
    wire_across_rim,
    plate_beside,
    plate_over,
    hammer,
    glove_wires,
    gauze_threads,
    other_leg,
)
_HELD_OUT: tuple[Draw, ...] = (
    drill_over_rim,
    clamp,
    lead_letter,
    pellets,
    skin_staples,
    fixator_pins,
    blocking_screw,
    cerclage_wires,
)


def _kind(draw: Draw) -> Kind:
    return rendered_kind(partial(cluttered_scene, draw), draw.__name__, first_line(draw))


_FILLINGS: tuple[Kind, ...] = tuple(
    rendered_kind(scene, scene.__name__, first_line(scene))
    for scene in (filled_holes, half_filled_holes, drilled_bone, drilled_filling)
)
KINDS: tuple[Kind, ...] = (*map(_kind, DRAWS), *_FILLINGS, *(held_out(_kind(draw)) for draw in _HELD_OUT))
BENCH = RobustnessBench("foreign_objects", "images with things in the way of the beam", KINDS)


def main(arguments: Sequence[str] = ()) -> int:
    """Run the kinds of this benchmark."""
    return run_bench(BENCH, arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
