"""Own scenes of two kinds at once, as hospitals have them; writes its part of docs/benchmarks/robustness.md.

usage: distalock bench combined [--kind NAME ...] [--count 20] [--seeds judged] [--rows FILE] [--images FOLDER]

Which kinds of the other benchmarks meet is drawn from the seed, without held-out ones on seeds that fit. What is
processed is the image that the other kind makes of the same seed.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace

from benchmarks.robustness import bent_nails, built_parts, foreign_objects, processing
from benchmarks.robustness.bent_nail import bent_truths, with_bent_nail
from benchmarks.robustness.command import SEEDS, RobustnessBench, run_bench
from benchmarks.robustness.kinds import Kind, first_line
from benchmarks.robustness.scene import (
    Drawn,
    ImageFolder,
    RobustScene,
    generator_of,
    rendered,
    scene_of_shot,
)
from benchmarks.scenes.random_scenes import scene_of_seed
from simulation.world.poses import starting_state, world_at

Combined = Callable[[int, ImageFolder], RobustScene]
# A guide of another size than its file's shows in no single image, processed or not (decision 21).
_NOT_OBSERVABLE = ("guide_1_percent_larger", "guide_3_percent_larger")
_BEND_RADII_MM = (500.0, 3000.0)
_BENT = tuple(kind for kind in bent_nails.KINDS if kind.name.startswith("bent_"))
_OTHER_NAILS = tuple(kind for kind in bent_nails.KINDS if kind not in _BENT)
# Kinds that came later stay out: with another number of them seeds would draw others than they did.
_LATER = ("drilled_filling",)
_OBJECTS = tuple(kind for kind in foreign_objects.KINDS if kind.name not in _LATER)
_PARTS = tuple(kind for kind in built_parts.KINDS if kind.name not in _NOT_OBSERVABLE)


def processed_object(seed: int, images: ImageFolder) -> RobustScene:
    """A thing in the way, and what a display does to the image."""
    return _one_processed("processed_object", _OBJECTS, seed, images)


def processed_bend(seed: int, images: ImageFolder) -> RobustScene:
    """A bent nail, and what a display does to the image."""
    return _one_processed("processed_bend", _BENT, seed, images)


def processed_nail(seed: int, images: ImageFolder) -> RobustScene:
    """A nail made otherwise than a straight bar with two round holes, and what a display does to the image."""
    return _one_processed("processed_nail", _OTHER_NAILS, seed, images)


def processed_parts(seed: int, images: ImageFolder) -> RobustScene:
    """Parts built otherwise than their files say, and what a display does to the image."""
    return _one_processed("processed_parts", _PARTS, seed, images)


def processed_twice(seed: int, images: ImageFolder) -> RobustScene:
    """One kind of processing after another."""
    return _one_processed("processed_twice", processing.KINDS, seed, images)


def processed_thing_on_bend(seed: int, images: ImageFolder) -> RobustScene:
    """A thing in the way of a bent nail, and what a display does to the image."""
    scene = images.scene(thing_on_bend.__name__, seed, thing_on_bend)
    return _processed("processed_thing_on_bend", scene, {})


def thing_on_bend(kind: str, seed: int) -> RobustScene:
    """A thing in the way of a bent nail."""
    generator, scenario = generator_of(kind, seed), scene_of_seed(seed)
    nail, state = scenario.parts.nail, starting_state(scenario)
    bend, drawn = bent_nails.drawn_bend(nail, _BEND_RADII_MM, generator)
    draw = foreign_objects.DRAWS[int(generator.integers(len(foreign_objects.DRAWS)))]
    world = world_at(scenario, state)
    objects, placed = foreign_objects.placed(draw, kind, scenario, world)
    shot = rendered(scenario, state, lambda packed, at: objects.added_to(with_bent_nail(packed, nail, bend, at)))
    named: Drawn = {"thing": draw.__name__}
    return scene_of_shot(kind, scenario, shot, named | drawn | placed, bent_truths(nail, bend, world))


def _one_processed(name: str, others: Sequence[Kind], seed: int, images: ImageFolder) -> RobustScene:
    """The scene that one of the other kinds makes of the seed, processed."""
    allowed = [kind for kind in others if _judges(seed) or not kind.judges_only]
    other = allowed[int(generator_of(name, seed).integers(len(allowed)))]
    return _processed(name, other.make(seed, images), {"other": other.name})


def _processed(name: str, scene: RobustScene, named: Drawn) -> RobustScene:
    """The scene through one operator; its parameters are those that this operator has on this seed."""
    operators = processing.OPERATORS | (processing.HELD_OUT if _judges(scene.seed) else {})
    chosen = str(generator_of(f"{name} operator", scene.seed).choice(list(operators)))
    made = processing.processed(operators[chosen], scene, generator_of(f"{name} {chosen}", scene.seed))
    parameters: Drawn = {f"operator_{parameter}": value for parameter, value in made.drawn.items()}
    return replace(made, kind=name, drawn=named | scene.drawn | {"operator": chosen} | parameters)


def _judges(seed: int) -> bool:
    return seed >= SEEDS["judged"]


_KINDS: tuple[Combined, ...] = (
    processed_object,
    processed_bend,
    processed_nail,
    processed_parts,
    processed_twice,
    processed_thing_on_bend,
)
KINDS: tuple[Kind, ...] = tuple(Kind(make.__name__, first_line(make), make) for make in _KINDS)
BENCH = RobustnessBench("combined", "two kinds of the other benchmarks at once", KINDS)


def main(arguments: Sequence[str] = ()) -> int:
    """Run the kinds of this benchmark."""
    return run_bench(BENCH, arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
