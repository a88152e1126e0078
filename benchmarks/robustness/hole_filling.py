"""What nail holes hold, and what a drill left in line with them.

Bone, drill dust and cement are foils of steel, spread over a hole's depth, that absorb as much.
"""

from itertools import pairwise

import numpy as np

from benchmarks.robustness.around import Around
from benchmarks.robustness.objects import Objects, SteelBox, axes_across, rod
from benchmarks.robustness.scene import Drawn, RobustScene, generator_of, rendered, scene_of_shot
from benchmarks.scenes.random_scenes import scene_of_seed
from simulation.world.poses import starting_state, world_at

# Steel over the whole depth: 0.18 mm absorb at 60 keV what 12 mm of bone do beyond as much soft tissue.
_STEEL_MM = (0.03, 0.25)
_FOILS, _STRIPS, _DEPTH_SHARE = 5, 14, 0.7
# Where a channel cuts them: more strips, for its edge, and fewer foils, for the time that an image takes.
_CUT_FOILS, _CUT_STRIPS = 3, 18
# Channels through a filling are drilled by hand: towards the beam, in which one sees the holes round, or nearly.
_CHANNEL_STEEL_MM, _CHANNEL_SHARES, _CHANNEL_LEANS = (0.05, 0.35), (0.6, 0.92), (0.0, 1.1)
# A drill goes through both walls of the bone, narrower than the hole, as askew as it can be in it.
_DRILL_SHARES, _DRILLED_MM, _LARGEST_TURN_RAD = (0.64, 0.92), 60.0, 0.12


def filled_holes(kind: str, seed: int) -> RobustScene:
    """All holes filled, as with bone or cement: 0.03 to 0.25 mm of steel over their depth, within a fifth alike."""
    generator = generator_of(kind, seed)
    steel_mm, turn = float(generator.uniform(*_STEEL_MM)), float(generator.uniform(0.0, 2.0 * np.pi))
    return _filled(kind, seed, steel_mm, turn, -1.0, generator)


def half_filled_holes(kind: str, seed: int) -> RobustScene:
    """Dust on the same wall of both holes, from 0.4 radii before the middle to 0.4 beyond; as much steel."""
    generator = generator_of(kind, seed)
    steel_mm, turn = float(generator.uniform(*_STEEL_MM)), float(generator.uniform(0.0, 2.0 * np.pi))
    return _filled(kind, seed, steel_mm, turn, float(generator.uniform(-0.4, 0.4)), generator)


def drilled_bone(kind: str, seed: int) -> RobustScene:
    """Bores through bone and holes, up to 7 degrees askew, as a drill of 0.64 to 0.92 hole widths leaves them."""
    generator = generator_of(kind, seed)
    scenario = scene_of_seed(seed)
    state = starting_state(scenario)
    share, turn = float(generator.uniform(*_DRILL_SHARES)), float(generator.uniform(0.0, 2.0 * np.pi))
    askew = float(generator.uniform(0.0, _LARGEST_TURN_RAD))
    world, bores = world_at(scenario, state), []
    for number in range(len(scenario.parts.nail.holes)):
        around = Around.of(scenario, world, number)
        towards, beside = axes_across(around.axis, turn)
        aside_mm = (1.0 - share) * around.rim_mm * generator.uniform(-1.0, 1.0, 2)
        middle = around.middle_mm + aside_mm[0] * towards + aside_mm[1] * beside
        half = 0.5 * _DRILLED_MM * (np.cos(askew) * around.axis + np.sin(askew) * towards)
        bores.append(rod(middle - half, middle + half, 2.0 * share * around.rim_mm))
    objects = Objects(bores=tuple(bores))
    shot = rendered(scenario, state, lambda packed, _: objects.added_to(packed))
    drawn: Drawn = {"share": share, "turn_rad": turn, "askew_deg": float(np.degrees(askew))}
    return scene_of_shot(kind, scenario, shot, drawn, shot.truth.holes)


def drilled_filling(kind: str, seed: int) -> RobustScene:
    """All holes filled, and drilled again: channels of 0.6 to 0.92 hole widths, from the holes' axis to the beam's."""
    generator = generator_of(kind, seed)
    steel_mm, share, lean = (float(generator.uniform(*r)) for r in (_CHANNEL_STEEL_MM, _CHANNEL_SHARES, _CHANNEL_LEANS))
    scenario = scene_of_seed(seed)
    state = starting_state(scenario)
    world, boxes = world_at(scenario, state), []
    for number in range(len(scenario.parts.nail.holes)):
        boxes += _foils_beside_channel(Around.of(scenario, world, number), steel_mm, share, lean)
    objects = Objects(boxes=tuple(boxes))
    shot = rendered(scenario, state, lambda packed, _: objects.added_to(packed))
    drawn: Drawn = {"steel_mm": steel_mm, "share": share, "lean": lean}
    return scene_of_shot(kind, scenario, shot, drawn, shot.truth.holes)


def _filled(
    kind: str, seed: int, steel_mm: float, turn_rad: float, from_radii: float, generator: np.random.Generator
) -> RobustScene:
    """All holes filled on one side of a line that lies `from_radii` from the middle."""
    scenario = scene_of_seed(seed)
    state = starting_state(scenario)
    world, boxes = world_at(scenario, state), []
    for number in range(len(scenario.parts.nail.holes)):
        around = Around.of(scenario, world, number)
        own_mm = steel_mm * float(generator.uniform(0.8, 1.2))
        boxes += _foils(around, own_mm, turn_rad, from_radii, generator)
    objects = Objects(boxes=tuple(boxes))
    shot = rendered(scenario, state, lambda packed, _: objects.added_to(packed))
    drawn: Drawn = {"steel_mm": steel_mm, "turn_rad": turn_rad, "from_radii": from_radii}
    return scene_of_shot(kind, scenario, shot, drawn, shot.truth.holes)


def _foils(
    around: Around, steel_mm: float, turn_rad: float, from_radii: float, generator: np.random.Generator
) -> list[SteelBox]:
    """Foils across the hole's axis, each of strips as long as the hole is wide there.

    The edges of a filling that does not reach all walls are ragged.
    """
    towards, beside = axes_across(around.axis, turn_rad)
    axes = np.array([towards, beside, around.axis])
    ragged = 0.2 * generator.uniform(-1.0, 1.0, _FOILS) * (from_radii > -1.0)
    strips = []
    for depth, edge in zip(np.linspace(-_DEPTH_SHARE, _DEPTH_SHARE, _FOILS), from_radii + ragged, strict=True):
        ends = np.linspace(edge, 1.0, _STRIPS + 1)
        middle = around.middle_mm + depth * around.nail_mm * around.axis
        for first, last in pairwise(ends):
            place, half = 0.5 * (first + last), 0.5 * (last - first)
            half_mm = around.rim_mm * np.array([half, np.sqrt(max(1.0 - place * place, 0.0)), 0.0])
            half_mm[2] = 0.5 * steel_mm / _FOILS
            strips.append(SteelBox(middle + place * around.rim_mm * towards, axes, half_mm))
    return strips


def _foils_beside_channel(around: Around, steel_mm: float, share: float, lean: float) -> list[SteelBox]:
    """Foils across the hole's axis, without a round channel through the hole's middle.

    The channel is as wide as a share of the hole, and leans from its axis by a share of the way to the beam.
    """
    towards, beside = axes_across(around.axis, 0.0)
    axes = np.array([towards, beside, around.axis])
    ray = around.ray * np.sign(around.ray @ around.axis)
    direction = (1.0 - lean) * around.axis + lean * ray
    slope = direction @ axes[:2].T / (direction @ around.axis) * around.nail_mm / around.rim_mm
    ends = np.linspace(-1.0, 1.0, _CUT_STRIPS + 1)
    strips = []
    for depth in np.linspace(-_DEPTH_SHARE, _DEPTH_SHARE, _CUT_FOILS):
        middle, aside = around.middle_mm + depth * around.nail_mm * around.axis, depth * slope
        for place in 0.5 * (ends[:-1] + ends[1:]):
            wall = float(np.sqrt(1.0 - place * place))
            gap = float(np.sqrt(max(share * share - (place - aside[0]) ** 2, 0.0)))
            left, right = np.clip([aside[1] - gap, aside[1] + gap], -wall, wall)
            for first, last in ((-wall, left), (right, wall)):
                if last > first:
                    half_mm = np.array([1.0 / _CUT_STRIPS, 0.5 * (last - first), 0.0]) * around.rim_mm
                    half_mm[2] = 0.5 * steel_mm / _CUT_FOILS
                    across_mm = around.rim_mm * (place * towards + 0.5 * (first + last) * beside)
                    strips.append(SteelBox(middle + across_mm, axes, half_mm))
    return strips
