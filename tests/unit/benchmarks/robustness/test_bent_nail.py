"""The bent nail: its centreline, its surface as the ray tracer has it, and the axes of its holes."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.robustness.bent_nail import Bend, bent_truths, local_hole, with_bent_nail, with_tip
from benchmarks.scenes.changed_parts import with_holes
from shared.geometry.lines import angle_between_rad, unit
from shared.geometry.parts import hole_surface_points
from simulation.render.attenuation import Material
from simulation.render.scene import balls_in_view, pack_scene
from simulation.render.tracer import PackedScene, trace_lengths
from simulation.world.poses import starting_state, world_at
from tests.unit.simulation import rooms

SCENARIO = rooms.scenario()
NAIL = SCENARIO.parts.nail
WORLD = world_at(SCENARIO, starting_state(SCENARIO))
PACKED = pack_scene(SCENARIO, WORLD, balls_in_view(SCENARIO, WORLD))
BENDS = (Bend(300.0, 0.4, -40.0), Bend(1000.0, 2.0, -20.0), Bend(3000.0, 4.5, -75.0))
SURFACE_MM = 0.01


def metal_mm(bend: Bend, points_beam: NDArray[np.float64]) -> NDArray[np.float64]:
    return metal_of(with_bent_nail(PACKED, NAIL, bend, WORLD), points_beam)


def metal_of(packed: PackedScene, points_beam: NDArray[np.float64]) -> NDArray[np.float64]:
    targets = points_beam[:, :2] / points_beam[:, 2:] * packed.detector_distance_mm
    lengths = trace_lengths(packed, np.ascontiguousarray(targets), np.full(len(targets), -1))
    return np.asarray(lengths[:, Material.TITANIUM])


def silhouette_mm(bend: Bend, x_mm: float, radius_mm: float) -> NDArray[np.float64]:
    """Points, shape (2, 3), where rays pass the centreline at x at a distance, on either side of the nail."""
    pose = WORLD.beam_from_nail @ bend.frame_at(x_mm)
    centre, tangent = pose.translation_mm, pose.directions(np.array([1.0, 0.0, 0.0]))
    across = unit(np.cross(centre, tangent))
    # the ray that touches a circle of this radius passes nearer to the centre's ray than the circle's point
    lean = np.arcsin(radius_mm / np.linalg.norm(centre - (centre @ tangent) * tangent))
    inwards = unit(centre - (centre @ tangent) * tangent)
    return np.array([centre + radius_mm * (s * np.cos(lean) * across - np.sin(lean) * inwards) for s in (1.0, -1.0)])


@pytest.mark.parametrize("bend", BENDS)
def test_the_centreline_is_an_arc_of_its_length_and_straight_before(bend: Bend) -> None:
    curved = np.linspace(bend.start_mm, 30.0, 400)
    points = np.array([bend.frame_at(float(x)).translation_mm for x in curved])
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(30.0 - bend.start_mm, rel=1e-6)
    sideways = np.array([0.0, np.cos(bend.direction_rad), np.sin(bend.direction_rad)])
    assert np.linalg.norm(points - bend.radius_mm * sideways, axis=1) == pytest.approx(bend.radius_mm, abs=1e-9)
    before = np.array([bend.frame_at(bend.start_mm - d).translation_mm for d in (0.0, 10.0, 20.0)])
    assert np.allclose(before[0] - before[1], before[1] - before[2])
    assert np.linalg.norm(before[0] - before[1]) == pytest.approx(10.0)


@pytest.mark.parametrize("bend", BENDS)
def test_the_pivot_keeps_place_and_tangent(bend: Bend) -> None:
    assert np.allclose(bend.frame_at(bend.pivot_mm).matrix, np.eye(4))


@pytest.mark.parametrize("bend", BENDS)
@pytest.mark.parametrize("x_mm", [-90.0, -37.3, -3.1, 0.0, 4.9, 11.7])
def test_the_traced_surface_is_within_a_hundredth_of_a_millimetre(bend: Bend, x_mm: float) -> None:
    radius = NAIL.radius_mm
    assert np.all(metal_mm(bend, silhouette_mm(bend, x_mm, radius + SURFACE_MM)) == 0.0)
    assert np.all(metal_mm(bend, silhouette_mm(bend, x_mm, radius - SURFACE_MM)) > 0.0)


@pytest.mark.parametrize("bend", BENDS)
def test_no_wedge_stays_open_between_the_pieces(bend: Bend) -> None:
    """Chords just inside the surface, all along the bend: each is about as long as its neighbours."""
    places = np.arange(bend.start_mm + 0.5, -20.0 if bend.start_mm < -25.0 else bend.start_mm + 5.0, 0.05)
    inside = np.concatenate([silhouette_mm(bend, float(x), NAIL.radius_mm - 0.1) for x in places])
    chords = metal_mm(bend, inside)
    assert chords.min() > 0.9 * np.median(chords)


@pytest.mark.parametrize("bend", BENDS)
def test_a_ray_along_the_middle_of_a_bent_hole_meets_no_metal(bend: Bend) -> None:
    middles = [
        (WORLD.beam_from_nail @ bend.frame_at(float(hole.axis.point_mm[0]))).translation_mm for hole in NAIL.holes
    ]
    assert np.all(metal_mm(bend, np.array(middles)) == 0.0)


def test_hole_axes_lean_against_each_other_by_their_distance_over_the_radius() -> None:
    bend = Bend(500.0, 0.5 * np.pi, -60.0)  # bends towards z, in the plane of the holes' axes
    truths = bent_truths(NAIL, bend, WORLD)
    apart = abs(float(NAIL.holes[0].axis.point_mm[0] - NAIL.holes[1].axis.point_mm[0]))
    assert angle_between_rad(truths[0].axis_guide, truths[1].axis_guide) == pytest.approx(apart / 500.0, rel=1e-9)


def test_a_hardly_bent_nail_has_the_truth_of_the_straight_one() -> None:
    bend = Bend(1e7, 1.0, -60.0)
    for truth, hole in zip(bent_truths(NAIL, bend, WORLD), NAIL.holes, strict=True):
        entry = hole_surface_points(NAIL, hole)[0]
        assert np.allclose(truth.entry_point_guide_mm, WORLD.guide_from_nail @ entry, atol=1e-4)
        assert np.allclose(truth.axis_guide, WORLD.guide_from_nail.directions(hole.axis.direction), atol=1e-5)
        assert local_hole(hole).axis.point_mm[0] == 0.0


def test_a_slot_is_open_to_its_ends_and_closed_beyond() -> None:
    hole, longer_mm = NAIL.holes[0], 5.0
    slot = replace(hole, slot_length_mm=hole.diameter_mm + longer_mm)
    slotted = with_holes(SCENARIO, (slot, *NAIL.holes[1:]))
    packed = pack_scene(slotted, WORLD, balls_in_view(slotted, WORLD))
    reach = 0.5 * longer_mm + 0.4 * hole.diameter_mm - 1.0
    shifts = np.linspace(-reach, reach, 9)[:, None] * np.array([1.0, 0.0, 0.0])
    assert np.all(metal_of(packed, WORLD.beam_from_nail @ (hole.axis.point_mm + shifts)) == 0.0)
    assert np.any(metal_of(PACKED, WORLD.beam_from_nail @ (hole.axis.point_mm + shifts)) > 0.0)
    beyond = hole.axis.point_mm + np.array([0.5 * longer_mm + 0.5 * hole.diameter_mm + 1.5, 0.0, 0.0])
    assert metal_of(packed, WORLD.beam_from_nail @ beyond[None])[0] > 1.0


@pytest.mark.parametrize("depth_mm", [2.0, 15.0])
def test_a_tip_is_half_an_ellipsoid_of_its_depth(depth_mm: float) -> None:
    packed = with_tip(PACKED, NAIL, depth_mm, WORLD)
    halfway = np.array([NAIL.tip_x_mm - 0.5 * depth_mm, 0.0, 0.0])
    outline = np.sqrt(0.75) * NAIL.radius_mm
    sides = np.array([halfway + np.array([0.0, y, 0.0]) for y in (0.9 * outline, 1.1 * outline)])
    inside, outside = metal_of(packed, WORLD.beam_from_nail @ sides)
    assert inside > 0.5
    assert outside == 0.0
    assert metal_of(packed, WORLD.beam_from_nail @ np.array([[NAIL.tip_x_mm + 0.3, 0.0, 0.0]]))[0] == 0.0
