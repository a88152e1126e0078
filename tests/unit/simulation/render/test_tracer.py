"""Path lengths per material along rays with known answers."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.lines import Line
from simulation.render.attenuation import Material
from simulation.render.scene import balls_in_view, pack_scene
from simulation.render.tracer import trace_lengths
from simulation.scenario.values import Scenario
from simulation.world.poses import Rod, World, WorldState, starting_state, world_at
from tests.unit.simulation import rooms

SPONGY = 7


def lengths_to(scenario: Scenario, world: World, points_beam: NDArray[np.float64]) -> NDArray[np.float64]:
    """Path lengths of rays through points of the beam's frame, without balls."""
    packed = pack_scene(scenario, world, balls_in_view(scenario, world))
    targets = points_beam[:, :2] / points_beam[:, 2:] * packed.detector_distance_mm
    return np.asarray(trace_lengths(packed, np.ascontiguousarray(targets), np.full(len(targets), -1)))


def aligned_state(scenario: Scenario) -> tuple[WorldState, World]:
    state = starting_state(scenario)
    return state, world_at(scenario, state)


def test_a_ray_along_a_bore_meets_no_metal() -> None:
    scenario = rooms.scenario()
    _, world = aligned_state(scenario)
    # The source is put on the hole's axis: a bore of 5.3 mm in an 11 mm nail is open for rays up to 25 degrees.
    hole = scenario.parts.nail.holes[0].axis
    point = world.beam_from_nail @ hole.point_mm
    found = lengths_to(scenario, world, point[None])
    assert found[0, Material.TITANIUM] == 0.0


def test_a_ray_across_the_solid_nail_has_its_chord() -> None:
    scenario = rooms.scenario()
    _, world = aligned_state(scenario)
    middle = world.beam_from_nail @ np.zeros(3)
    axis, ray = world.beam_from_nail.directions(np.array([1.0, 0.0, 0.0])), middle / np.linalg.norm(middle)
    chord = 11.0 / np.linalg.norm(np.cross(axis, ray))
    assert lengths_to(scenario, world, middle[None])[0, Material.TITANIUM] == pytest.approx(chord, abs=1e-6)


def test_a_cannulation_takes_its_own_chord_away() -> None:
    base = rooms.scenario()
    scenario = replace(base, parts=replace(base.parts, nail=rooms.nail(cannulation_mm=4.5)))
    _, world = aligned_state(scenario)
    middle = world.beam_from_nail @ np.zeros(3)
    axis, ray = world.beam_from_nail.directions(np.array([1.0, 0.0, 0.0])), middle / np.linalg.norm(middle)
    chord = (11.0 - 4.5) / np.linalg.norm(np.cross(axis, ray))
    assert lengths_to(scenario, world, middle[None])[0, Material.TITANIUM] == pytest.approx(chord, abs=1e-6)


def test_the_guide_block_has_its_thickness_and_its_bores_none() -> None:
    scenario = rooms.scenario()
    _, world = aligned_state(scenario)
    pose = world.beam_from_guide
    # 2.4 mm off the bore's axis: still inside a bore of 5 mm where the ray is nearly along it.
    points = pose @ np.array([[0.0, 0.0, 0.0], [15.0, 0.0, 0.0]])
    found = lengths_to(scenario, world, points)[:, Material.DELRIN]
    ray = points[0] / np.linalg.norm(points[0])
    assert found[0] == pytest.approx(15.0 / (pose.directions(np.array([0.0, 0.0, 1.0])) @ ray), abs=1e-6)
    assert found[1] < 1e-9


def test_two_plates_are_crossed() -> None:
    scenario = rooms.scenario()
    _, world = aligned_state(scenario)
    points = world.beam_from_ring @ np.array([[60.0, 30.0, 0.0]])
    ray = points[0] / np.linalg.norm(points[0])
    along = world.beam_from_ring.directions(np.array([0.0, 0.0, 1.0])) @ ray
    assert lengths_to(scenario, world, points)[0, Material.PMMA] == pytest.approx(6.0 / along, abs=1e-6)


def test_a_wire_is_steel_and_a_drilled_hole_takes_bone_away() -> None:
    scenario = replace(rooms.scenario(), parts=rooms.scenario().parts)
    state, _ = aligned_state(scenario)
    # Across the cortex of the shaft, far from the nail's holes.
    across = Line(np.array([-70.0, 12.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    bare = replace(state, nail_present=False, guide_present=False)
    rod = Rod("distal", across, -200.0, 200.0, 4.0)
    point = world_at(scenario, bare).beam_from_bone @ across.point_mm
    untouched, drilled, wired = (
        lengths_to(scenario, world_at(scenario, s), point[None])[0]
        for s in (bare, replace(bare, drilled=(rod,)), replace(bare, wires=(rod,)))
    )
    assert untouched[Material.CORTICAL_BONE] > 5.0
    assert drilled[Material.CORTICAL_BONE] == pytest.approx(0.0, abs=1e-9)
    assert drilled[Material.MUSCLE] > untouched[Material.MUSCLE] + 5.0
    assert wired[Material.STEEL] > untouched[Material.CORTICAL_BONE]


def test_materials_share_the_way_through_the_thigh() -> None:
    scenario = rooms.scenario()
    state, _ = aligned_state(scenario)
    bare = world_at(scenario, replace(state, nail_present=False, guide_present=False))
    without_bone = 2.0 * scenario.anatomy.thigh_half_axes_mm[1]
    centre = np.array([-280.0, *scenario.anatomy.thigh_centre_mm])
    found = lengths_to(scenario, bare, (bare.beam_from_bone @ np.array([-30.0, *centre[1:]]))[None])[0]
    through = found[Material.MUSCLE] + found[Material.CORTICAL_BONE] + found[SPONGY]
    assert through == pytest.approx(without_bone, rel=0.08)


def test_balls_are_seen_through_their_tiles() -> None:
    scenario = rooms.scenario()
    _, world = aligned_state(scenario)
    balls = balls_in_view(scenario, world)
    packed = pack_scene(scenario, world, balls)
    scale = packed.detector_distance_mm / balls.centre_mm[:, 2:]
    column, row = np.rint(balls.image_px).astype(int).T
    tile = (row // packed.tile_px) * packed.tiles_across + column // packed.tile_px
    found = trace_lengths(packed, np.ascontiguousarray(balls.centre_mm[:, :2] * scale), tile)
    assert np.all(found[:, Material.STEEL] >= 2.0 * balls.radius_mm - 1e-6)
