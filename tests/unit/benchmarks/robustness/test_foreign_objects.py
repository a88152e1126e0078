"""Things in the way: their shadows lie where their parameters say."""

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.robustness.around import Around
from benchmarks.robustness.foreign_objects import retractor, screw_half_in, wire_across_rim
from benchmarks.robustness.held_out import clamp, drill_over_rim, lead_letter
from benchmarks.robustness.held_out_metal import blocking_screw, cerclage_wires, fixator_pins, pellets, skin_staples
from benchmarks.robustness.objects import Objects, ball, rod
from shared.geometry.lines import unit
from simulation.render.attenuation import Material
from simulation.render.scene import balls_in_view, pack_scene
from simulation.render.tracer import trace_lengths
from simulation.world.poses import starting_state, world_at
from tests.unit.simulation import rooms

SCENARIO = rooms.scenario()
WORLD = world_at(SCENARIO, starting_state(SCENARIO))
PACKED = pack_scene(SCENARIO, WORLD, balls_in_view(SCENARIO, WORLD))
SEEDS = range(6)


def around() -> Around:
    return Around.of(SCENARIO, WORLD, 0)


def steel_mm(objects: Objects, points_beam: NDArray[np.float64]) -> NDArray[np.float64]:
    """Steel on the rays from the focal spot through points, shape (N,), without balls."""
    packed = objects.added_to(PACKED)
    targets = points_beam[:, :2] / points_beam[:, 2:] * packed.detector_distance_mm
    lengths = trace_lengths(packed, np.ascontiguousarray(targets), np.full(len(targets), -1))
    return np.asarray(lengths[:, Material.STEEL])


def rim(of: Around, radius_mm: float, count: int = 720) -> NDArray[np.float64]:
    """Points on a circle about the hole's middle, across the ray."""
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)[:, None]
    first = unit(np.cross(of.ray, np.array([0.0, 1.0, 0.0])))
    return np.asarray(of.middle_mm + radius_mm * (np.cos(angle) * first + np.sin(angle) * np.cross(of.ray, first)))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_retractor_covers_the_drawn_part_of_the_rim_and_no_other_hole(seed: int) -> None:
    one = around()
    objects, drawn = retractor(one, np.random.default_rng(seed))
    covered = steel_mm(objects, rim(one, one.rim_mm)) > 0.0
    assert np.mean(covered) == pytest.approx(drawn["covered"], abs=0.01)
    assert np.all(steel_mm(objects, one.others_mm) == 0.0)
    assert not covered.all()


@pytest.mark.parametrize("seed", SEEDS)
def test_the_wire_crosses_the_ray_at_its_offset(seed: int) -> None:
    one = around()
    objects, drawn = wire_across_rim(one, np.random.default_rng(seed))
    offset = float(drawn["offset_mm"])
    assert np.any(steel_mm(objects, rim(one, abs(offset) + 1e-3)) > 0.0)
    assert steel_mm(objects, rim(one, abs(offset) + 1e-3)).max() <= float(drawn["diameter_mm"]) / np.cos(0.5)
    assert np.any(steel_mm(objects, rim(one, one.rim_mm)) > 0.0) or abs(offset) > one.rim_mm


@pytest.mark.parametrize("seed", SEEDS)
def test_the_screw_ends_in_the_middle_of_the_hole(seed: int) -> None:
    one = around()
    objects, drawn = screw_half_in(one, np.random.default_rng(seed))
    points = np.array([row[:3] for row in objects.rods])
    along = float(drawn["side"]) * (points - one.middle_mm) @ one.axis
    assert along.min() == pytest.approx(0.0, abs=1e-9)
    assert along.max() > 20.0


@pytest.mark.parametrize("seed", SEEDS)
def test_held_out_objects_lie_about_the_hole(seed: int) -> None:
    one = around()
    for draw in (drill_over_rim, clamp, lead_letter):
        objects, drawn = draw(one, np.random.default_rng(seed))
        circle = rim(one, float(drawn["offset_mm"]) + 0.3)
        assert np.any(steel_mm(objects, circle) > 0.0), draw.__name__


@pytest.mark.parametrize("seed", SEEDS)
def test_the_covered_share_is_that_of_the_traced_rays(seed: int) -> None:
    one = around()
    for draw in (retractor, screw_half_in, wire_across_rim):
        objects, _ = draw(one, np.random.default_rng(seed))
        traced = steel_mm(objects, one.inside_rim()) > 0.0
        assert objects.covered_share(one.inside_rim()) == pytest.approx(np.mean(traced), abs=0.02)
    assert objects.covered_share(one.others_mm) in (0.0, 1.0)


def test_nothing_added_changes_nothing() -> None:
    one = around()
    points = rim(one, 3.0, 36)
    assert np.array_equal(steel_mm(Objects(), points), np.zeros(len(points)))


def test_a_bore_replaces_bone_by_soft_tissue_and_leaves_the_metal() -> None:
    one = around()
    bore = Objects(bores=(rod(one.middle_mm - 40.0 * one.axis, one.middle_mm + 40.0 * one.axis, 4.0),))
    middle = (one.middle_mm / one.middle_mm[2] * PACKED.detector_distance_mm)[None, :2]
    before, after = (
        trace_lengths(packed, np.ascontiguousarray(middle), np.full(1, -1))[0]
        for packed in (PACKED, bore.added_to(PACKED))
    )
    metal = [Material.STEEL, Material.TITANIUM]
    assert after[Material.CORTICAL_BONE] < before[Material.CORTICAL_BONE] - 2.0
    assert after.sum() == pytest.approx(before.sum())
    np.testing.assert_allclose(after[metal], before[metal])
    assert bore.covered_share(one.inside_rim()) == 0.0


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.9])
def test_a_ball_of_slices_is_as_thick_as_a_ball(share: float) -> None:
    one, diameter_mm = around(), 4.0
    objects = Objects(rods=ball(one.middle_mm, diameter_mm))
    thickness = steel_mm(objects, rim(one, 0.5 * diameter_mm * share, count=36) if share else one.middle_mm[None])
    assert thickness == pytest.approx(diameter_mm * np.sqrt(1.0 - share**2), abs=0.05 * diameter_mm)


@pytest.mark.parametrize("seed", SEEDS)
def test_fixator_pins_pass_the_hole_and_leave_it_free(seed: int) -> None:
    one = around()
    objects, drawn = fixator_pins(one, np.random.default_rng(seed))
    offset, diameter = float(drawn["offset_mm"]), float(drawn["diameter_mm"])
    assert np.any(steel_mm(objects, rim(one, offset + 0.5 * diameter)) > 0.0)
    assert np.all(steel_mm(objects, rim(one, one.rim_mm)) == 0.0)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_blocking_screw_touches_the_nail_at_most(seed: int) -> None:
    one = around()
    objects, drawn = blocking_screw(one, np.random.default_rng(seed))
    at_nail = one.middle_mm + float(drawn["along_mm"]) * one.along_nail
    outwards = float(drawn["side"]) * unit(np.cross(one.ray, one.along_nail))
    beside = at_nail + (one.nail_mm + float(drawn["gap_mm"]) + 0.5 * float(drawn["diameter_mm"])) * outwards
    assert steel_mm(objects, beside[None])[0] > 10.0
    assert steel_mm(objects, at_nail[None])[0] == 0.0


@pytest.mark.parametrize("seed", SEEDS)
def test_wires_loop_about_the_bone_and_cross_the_nail(seed: int) -> None:
    one = around()
    objects, drawn = cerclage_wires(one, np.random.default_rng(seed))
    along = np.linspace(-15.0, 45.0, 1201)[:, None] * one.along_nail
    steel = np.maximum(steel_mm(objects, one.middle_mm + along), steel_mm(objects, one.middle_mm - along))
    assert 0.0 < steel.max() <= 2.0 * float(drawn["diameter_mm"]) / np.cos(0.6)
    middles = np.array([row[:3] for row in objects.rods])[::9] - one.middle_mm
    assert np.abs(middles @ one.along_nail).min() <= 8.0 + 22.0 * np.tan(0.3)


@pytest.mark.parametrize("seed", SEEDS)
def test_pellets_and_staples_are_as_many_as_drawn(seed: int) -> None:
    one = around()
    objects, drawn = pellets(one, np.random.default_rng(seed))
    assert len(objects.rods) == 8 * int(drawn["count"])
    objects, drawn = skin_staples(one, np.random.default_rng(seed))
    assert len(objects.rods) == 3 * int(drawn["count"])
    tops = np.array([row[:3] for row in objects.rods])
    assert np.all((tops - one.middle_mm) @ one.ray < -30.0)  # on the skin towards the tube
