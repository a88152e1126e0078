"""Own scenes with nails that are bent or made otherwise than a straight bar; part of docs/benchmarks/robustness.md.

usage: distalock bench bent_nails [--kind NAME ...] [--count 20] [--seeds judged] [--rows FILE] [--images FOLDER]

The part file that a localisation gets stays that of the straight nail with two parallel round holes, but where the
kind says what is filed. The truth of each hole is its own axis. A bent nail keeps the place and the tangent of its file
halfway between the holes.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.robustness.bent_nail import Bend, bent_truths, with_bent_nail, with_tip
from benchmarks.robustness.command import RobustnessBench, run_bench
from benchmarks.robustness.kinds import Kind, first_line, rendered_kind
from benchmarks.robustness.scene import BESIDE_FILE_MM, Drawn, RobustScene, generator_of, rendered, scene_of_shot
from benchmarks.scenes.changed_parts import with_holes, with_nail_holes
from benchmarks.scenes.random_scenes import scene_of_seed
from shared.geometry.lines import Line, unit
from shared.geometry.parts import Hole, NailPart
from simulation.render.image import ChangePacked
from simulation.scenario.values import Scenario
from simulation.world.poses import starting_state, world_at

_RADII_MM = ((300.0, 700.0), (700.0, 1500.0), (1500.0, 3000.0))
_STRAIGHT_BEFORE_MM = 60.0
_BULLET = (0.3, 3.0)
_X, _APART_MM = np.array([1.0, 0.0, 0.0]), 12.0


def bent_scene(radii_mm: tuple[float, float], kind: str, seed: int) -> RobustScene:
    """Constant curvature of such a radius (mm) in a random plane, from at most 60 mm before the proximal hole."""
    generator, scenario = generator_of(kind, seed), scene_of_seed(seed)
    nail, state = scenario.parts.nail, starting_state(scenario)
    bend, drawn = drawn_bend(nail, radii_mm, generator)
    shot = rendered(scenario, state, lambda packed, world: with_bent_nail(packed, nail, bend, world))
    return scene_of_shot(kind, scenario, shot, drawn, bent_truths(nail, bend, world_at(scenario, state)))


def drawn_bend(nail: NailPart, radii_mm: tuple[float, float], generator: np.random.Generator) -> tuple[Bend, Drawn]:
    """A bend of such a radius in any direction, which begins at most 60 mm before the proximal hole."""
    first_mm = min(float(hole.axis.point_mm[0]) for hole in nail.holes)
    radius = float(np.exp(generator.uniform(*np.log(radii_mm))))
    direction, before = float(generator.uniform(0.0, 2.0 * np.pi)), float(generator.uniform(0.0, _STRAIGHT_BEFORE_MM))
    bend = Bend(radius, direction, first_mm - before)
    return bend, {"radius_mm": radius, "direction_rad": direction, "start_mm": bend.start_mm}


def hole_spacing(kind: str, seed: int) -> RobustScene:
    """Holes 0.1 to 0.7 mm nearer or farther apart than the file says."""
    generator, scenario = generator_of(kind, seed), scene_of_seed(seed)
    off_mm = float(generator.choice([-1.0, 1.0]) * generator.uniform(0.1, 0.7))

    def moved(axis: Line) -> Line:
        shift = 0.5 * off_mm * np.sign(axis.point_mm[0])
        return Line(axis.point_mm + np.array([shift, 0.0, 0.0]), axis.direction)

    return _straight_scene(kind, with_nail_holes(scenario, moved), {"off_mm": off_mm, BESIDE_FILE_MM: abs(off_mm)})


def tilted_holes(kind: str, seed: int) -> RobustScene:
    """Hole axes 0.2 to 1 degree askew against each other, about the middles of the holes."""
    generator, scenario = generator_of(kind, seed), scene_of_seed(seed)
    angle_deg, turn = float(generator.uniform(0.2, 1.0)), float(generator.uniform(0.0, 2.0 * np.pi))
    lean = np.tan(np.radians(0.5 * angle_deg)) * np.array([np.cos(turn), np.sin(turn), 0.0])

    def tilted(axis: Line) -> Line:
        direction = axis.direction + np.sign(axis.point_mm[0]) * lean
        return Line(axis.point_mm, direction / np.linalg.norm(direction))

    return _straight_scene(kind, with_nail_holes(scenario, tilted), {"angle_deg": angle_deg, "turn_rad": turn})


def chamfers(kind: str, seed: int) -> RobustScene:
    """Both rims of both holes countersunk to a depth from none to 1 mm."""
    depth_mm, scenario = float(generator_of(kind, seed).uniform(0.0, 1.0)), scene_of_seed(seed)
    holes = tuple(replace(hole, chamfer_mm=depth_mm) for hole in scenario.parts.nail.holes)
    return _straight_scene(kind, with_holes(scenario, holes), {"depth_mm": depth_mm})


def rounded_tip(kind: str, seed: int) -> RobustScene:
    """A tip from nearly flat (0.3 radii deep) to a bullet (3 radii), where the file's is half a ball."""
    share, scenario = float(generator_of(kind, seed).uniform(*_BULLET)), scene_of_seed(seed)
    nail = scenario.parts.nail
    depth_mm = share * nail.radius_mm
    drawn: Drawn = {"radii": share}
    return _straight_scene(kind, scenario, drawn, lambda packed, world: with_tip(packed, nail, depth_mm, world))


def oblong_slot(kind: str, seed: int) -> RobustScene:
    """The proximal hole 2 to 6 mm longer along the nail than the file says; its axis is that of the slot's middle."""
    longer_mm, scenario = float(generator_of(kind, seed).uniform(2.0, 6.0)), scene_of_seed(seed)
    changed = with_holes(scenario, _with_proximal_slot(scenario.parts.nail.holes, longer_mm))
    return _straight_scene(kind, changed, {"longer_mm": longer_mm, BESIDE_FILE_MM: longer_mm})


def oblong_holes(kind: str, seed: int) -> RobustScene:
    """The proximal hole a slot, 2 to 6 mm longer along the nail than wide, as the file says."""
    longer_mm, scenario = float(generator_of(kind, seed).uniform(2.0, 6.0)), scene_of_seed(seed)
    holes = _with_proximal_slot(scenario.parts.nail.holes, longer_mm)
    scene = _straight_scene(kind, with_holes(scenario, holes), {"longer_mm": longer_mm})
    return replace(scene, filed_holes=holes)


def slot_in_file(kind: str, seed: int) -> RobustScene:
    """Round holes, of which the file says that the proximal one is a slot, 2 to 6 mm longer than wide."""
    longer_mm, scenario = float(generator_of(kind, seed).uniform(2.0, 6.0)), scene_of_seed(seed)
    scene = _straight_scene(kind, scenario, {"longer_mm": longer_mm, BESIDE_FILE_MM: longer_mm})
    return replace(scene, filed_holes=_with_proximal_slot(scenario.parts.nail.holes, longer_mm))


def four_holes(kind: str, seed: int) -> RobustScene:
    """Two more holes, one across the beam and one 30 to 60 degrees askew; file and guide say which to localise."""
    generator, scenario = generator_of(kind, seed), scene_of_seed(seed)
    turn = float(np.radians(generator.choice([-1.0, 1.0]) * generator.uniform(30.0, 60.0)))
    usual = scenario.parts.nail.holes
    first_mm = min(float(hole.axis.point_mm[0]) for hole in usual)
    diameter_mm = usual[0].diameter_mm
    further = (
        Hole("anterior", Line(np.zeros(3), np.array([0.0, 1.0, 0.0])), diameter_mm),
        Hole(
            "oblique", Line(first_mm * _X + _APART_MM * -_X, np.array([0.0, np.sin(turn), np.cos(turn)])), diameter_mm
        ),
    )
    scene = _straight_scene(kind, with_holes(scenario, (*usual, *further)), {"turn_rad": turn})
    return replace(scene, holes=scene.holes[: len(usual)], filed_holes=(*usual, *further))


def leaning_holes(kind: str, seed: int) -> RobustScene:
    """Each hole leaning by up to 6 degrees along the nail and about it, as the file says."""
    generator, scenario = generator_of(kind, seed), scene_of_seed(seed)
    lean = np.tan(np.radians(generator.uniform(-6.0, 6.0, size=(len(scenario.parts.nail.holes), 2))))
    holes = tuple(
        replace(hole, axis=Line(hole.axis.point_mm, np.array([*aside, 1.0]) / np.hypot(1.0, np.hypot(*aside))))
        for hole, aside in zip(scenario.parts.nail.holes, lean, strict=True)
    )
    drawn: Drawn = {"along_deg": float(np.degrees(lean[0, 0])), "about_deg": float(np.degrees(lean[0, 1]))}
    return replace(_straight_scene(kind, with_holes(scenario, holes), drawn), filed_holes=holes)


def bored_again(kind: str, seed: int) -> RobustScene:
    """Both holes bored once more about their middles, 0.5 to 3 degrees askew, by a drill of 0.9 to 1 of their width."""
    generator, scenario = generator_of(kind, seed), scene_of_seed(seed)
    askew_deg, turn = float(generator.uniform(0.5, 3.0)), float(generator.uniform(0.0, 2.0 * np.pi))
    share, usual = float(generator.uniform(0.9, 1.0)), scenario.parts.nail.holes
    lean = np.tan(np.radians(askew_deg)) * np.array([np.cos(turn), np.sin(turn), 0.0])
    again = tuple(
        replace(
            hole,
            id=f"{hole.id} again",
            axis=Line(hole.axis.point_mm, unit(hole.axis.direction + lean)),
            diameter_mm=share * hole.diameter_mm,
        )
        for hole in usual
    )
    cut_mm = scenario.parts.nail.radius_mm * float(np.tan(np.radians(askew_deg)))
    drawn: Drawn = {"askew_deg": askew_deg, "turn_rad": turn, "share": share, BESIDE_FILE_MM: cut_mm}
    scene = _straight_scene(kind, with_holes(scenario, (*usual, *again)), drawn)
    return replace(scene, holes=scene.holes[: len(usual)], filed_holes=usual)


def _with_proximal_slot(holes: tuple[Hole, ...], longer_mm: float) -> tuple[Hole, ...]:
    proximal = min(holes, key=lambda one: float(one.axis.point_mm[0]))
    slot = replace(proximal, slot_length_mm=proximal.diameter_mm + longer_mm)
    return tuple(slot if hole is proximal else hole for hole in holes)


def _straight_scene(
    kind: str, scenario: Scenario, drawn: Drawn, change: ChangePacked = lambda packed, _: packed
) -> RobustScene:
    shot = rendered(scenario, starting_state(scenario), change)
    return scene_of_shot(kind, scenario, shot, drawn, shot.truth.holes)


def _bent_kind(low_mm: float, high_mm: float) -> Kind:
    name = f"bent_{low_mm:.0f}_to_{high_mm:.0f}"
    return rendered_kind(partial(bent_scene, (low_mm, high_mm)), name, first_line(bent_scene))


KINDS: tuple[Kind, ...] = (
    *(_bent_kind(*radii) for radii in _RADII_MM),
    *(rendered_kind(make) for make in (hole_spacing, tilted_holes, chamfers, rounded_tip)),
    *(rendered_kind(make) for make in (oblong_slot, oblong_holes, slot_in_file, four_holes, leaning_holes)),
    rendered_kind(bored_again),
)
BENCH = RobustnessBench("bent_nails", "nails that are bent or made otherwise than their file says", KINDS)


def main(arguments: Sequence[str] = ()) -> int:
    """Run the kinds of this benchmark."""
    return run_bench(BENCH, arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
