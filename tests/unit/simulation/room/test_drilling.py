"""The drill rule with numbers worked out by hand. Nail: 11 mm, holes of 5.3 mm; drill 4.0 mm: clearance 0.65 mm."""

from dataclasses import replace

import numpy as np
import pytest

from shared.geometry.frames import Guide, Nail, RobotBase, RobotTop
from shared.geometry.transform import Transform
from simulation.room.drilling import HoleUnknown, Strike, deflection, drill, drill_force_n, insert_wire
from simulation.scenario.values import Scenario
from simulation.world.poses import WorldState, bone_from_guide, starting_state
from tests.unit.simulation import rooms

STANDOFF_MM = 100.0
NO_FORCE = np.zeros(3)


def state_with_guide_at(scenario: Scenario, nail_from_guide: Transform[Nail, Guide]) -> WorldState:
    """A state in which the platform holds the guide exactly there, whatever the legs say to it."""
    placement = scenario.placement
    head = scenario.parts.hexapod.top_from_guide(scenario.head_extension_mm)
    platform: Transform[RobotBase, RobotTop] = (
        placement.bone_from_base.inverse() @ placement.bone_from_nail @ nail_from_guide @ head.inverse()
    )
    return replace(starting_state(scenario), platform=platform)


def shifted(x_mm: float, y_mm: float) -> Transform[Nail, Guide]:
    return Transform.from_rotvec(np.zeros(3), [x_mm, y_mm, -STANDOFF_MM])


def tilted_about_entry(tilt_deg: float, y_mm: float = 0.0) -> Transform[Nail, Guide]:
    """Both axes turned about the nail's x axis, crossing the hole's entry (z = -5.5) at a distance y."""
    tilt = np.radians(tilt_deg)
    turned: Transform[Nail, Guide] = Transform.from_rotvec([tilt, 0.0, 0.0], np.zeros(3))
    entry = np.array([0.0, y_mm, -5.5])
    return Transform.from_rotation_translation(turned.rotation, entry - 94.5 * turned.rotation[:, 2])


@pytest.mark.parametrize(("offset_mm", "passes"), [(0.0, True), (0.64, True), (0.66, False)])
def test_a_parallel_axis_passes_up_to_the_clearance(offset_mm: float, *, passes: bool) -> None:
    scenario = rooms.scenario()
    went = drill(scenario, state_with_guide_at(scenario, shifted(offset_mm, 0.0)), "distal", NO_FORCE)
    assert went.passed is passes
    assert went.clearance_mm == pytest.approx(0.65)
    assert went.entry_offset_mm == pytest.approx(offset_mm)
    assert went.exit_offset_mm == pytest.approx(offset_mm)
    assert went.angle_deg == pytest.approx(0.0, abs=1e-6)


def test_offset_and_tilt_pass_each_alone_but_not_both() -> None:
    # Over 11 mm of bore, 3.3 degrees lead 0.634 mm aside: centred at the entry it passes, 0.1 mm off it does not.
    scenario = rooms.scenario()
    alone = drill(scenario, state_with_guide_at(scenario, tilted_about_entry(-3.3)), "distal", NO_FORCE)
    both = drill(scenario, state_with_guide_at(scenario, tilted_about_entry(-3.3, y_mm=0.1)), "distal", NO_FORCE)
    assert alone.passed
    assert alone.exit_offset_mm == pytest.approx(11.0 * np.tan(np.radians(3.3)), abs=1e-9)
    assert alone.angle_deg == pytest.approx(3.3)
    assert not both.passed
    assert both.strike is Strike.BORE_WALL
    # It reaches 0.65 mm after (0.65 - 0.1) / tan(3.3 deg) = 9.54 mm from the entry at z = -5.5.
    assert both.strike_point_nail_mm == pytest.approx([15.0, 0.65, -5.5 + 9.539], abs=2e-3)


@pytest.mark.parametrize(("along_mm", "across_mm", "passes"), [(2.6, 0.0, True), (2.7, 0.0, False), (1.0, 0.7, False)])
def test_in_a_slot_a_drill_has_room_along_the_nail(along_mm: float, across_mm: float, *, passes: bool) -> None:
    scenario = rooms.scenario()
    slot = replace(scenario.parts.nail.holes[0], slot_length_mm=9.3)
    nail = replace(scenario.parts.nail, holes=(slot, *scenario.parts.nail.holes[1:]))
    slotted = replace(scenario, parts=replace(scenario.parts, nail=nail))
    went = drill(slotted, state_with_guide_at(slotted, shifted(along_mm, across_mm)), slot.id, NO_FORCE)
    assert went.passed is passes
    assert went.entry_offset_mm == pytest.approx(np.hypot(along_mm, across_mm))


def test_it_strikes_the_nails_surface_when_it_is_off_at_the_entry() -> None:
    scenario = rooms.scenario()
    went = drill(scenario, state_with_guide_at(scenario, shifted(1.0, 0.0)), "distal", NO_FORCE)
    assert went.strike is Strike.NAIL_SURFACE
    assert went.strike_point_nail_mm == pytest.approx([16.0, 0.0, -5.5])
    assert went.rod.end_mm == pytest.approx(STANDOFF_MM - 5.5)


@pytest.mark.parametrize(("offset_mm", "strike"), [(7.4, Strike.NAIL_SURFACE), (7.6, Strike.BESIDE_THE_NAIL)])
def test_it_goes_beside_the_nail_when_it_is_far_off(offset_mm: float, strike: Strike) -> None:
    # Radius of the nail 5.5 mm, of the drill 2 mm: it touches up to 7.5 mm.
    scenario = rooms.scenario()
    assert drill(scenario, state_with_guide_at(scenario, shifted(0.0, offset_mm)), "distal", NO_FORCE).strike is strike


def test_without_a_nail_nothing_passes() -> None:
    scenario = rooms.scenario()
    state = replace(state_with_guide_at(scenario, shifted(0.0, 0.0)), nail_present=False)
    assert drill(scenario, state, "distal", NO_FORCE).strike is Strike.BESIDE_THE_NAIL


def test_a_thin_wire_passes_where_the_drill_does_not() -> None:
    scenario = rooms.scenario()
    state = state_with_guide_at(scenario, shifted(1.5, 0.0))
    assert insert_wire(scenario, state, "distal").passed
    assert not drill(scenario, state, "distal", NO_FORCE).passed


def test_the_guide_yields_by_force_over_stiffness() -> None:
    # 20 N over 200 N/mm: 0.1 mm. Moment about the guide's middle: 7.5 mm below it and 15 mm beside it,
    # r x F = (15, 0, 7.5) x (0, 20, 0) = (-150, 0, 300) N mm, over 5000 N mm/deg: (-0.03, 0, 0.06) degrees.
    yielding = deflection(rooms.scenario(), rooms.guide().holes[0], np.array([0.0, 20.0, 0.0]))
    np.testing.assert_allclose(yielding.translation_mm, [0.0, 0.1, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.degrees(yielding.rotation_vector_rad), [-0.03, 0.0, 0.06], atol=1e-9)


def test_a_softer_mount_yields_more() -> None:
    stiff = rooms.scenario()
    soft = replace(stiff, drilling=replace(stiff.drilling, stiffness_share=0.5))
    force = np.array([10.0, 0.0, 0.0])
    hole = rooms.guide().holes[0]
    assert deflection(soft, hole, force).translation_mm[0] == pytest.approx(
        2.0 * deflection(stiff, hole, force).translation_mm[0]
    )


def test_drilling_is_off_by_the_deflection() -> None:
    scenario = rooms.scenario()
    state = state_with_guide_at(scenario, shifted(0.0, 0.0))
    went = drill(scenario, state, "distal", np.array([0.0, 20.0, 0.0]))
    assert went.deflection_mm == pytest.approx(0.1)
    # 0.1 mm and -0.03 degrees about x over 94.5 mm (+0.0495 mm), 0.06 degrees about z at 15 mm (+0.0157 mm).
    assert went.entry_offset_mm == pytest.approx(0.1 + 0.0495 + 0.0157, abs=1e-3)


def test_forces_are_sideways_within_their_range_and_seeded() -> None:
    scenario = rooms.scenario()
    forces = [drill_force_n(scenario, n) for n in range(50)]
    magnitudes = np.linalg.norm(forces, axis=1)
    assert np.all((magnitudes >= 5.0) & (magnitudes <= 20.0))
    assert np.all(np.array(forces)[:, 2] == 0.0)
    np.testing.assert_array_equal(forces[3], drill_force_n(scenario, 3))


@pytest.mark.parametrize("act", [insert_wire, lambda sc, st, name: drill(sc, st, name, NO_FORCE)])
def test_an_unknown_hole_is_named_with_those_that_exist(act) -> None:  # type: ignore[no-untyped-def]
    scenario = rooms.scenario()
    with pytest.raises(HoleUnknown, match="the guide has no hole 'middle'; its holes are 'distal', 'proximal'"):
        act(scenario, starting_state(scenario), "middle")


def test_wires_follow_the_guide() -> None:
    scenario = rooms.scenario()
    state = starting_state(scenario)
    went = insert_wire(scenario, state, "proximal")
    pose = bone_from_guide(scenario, state)
    np.testing.assert_allclose(went.rod.axis.point_mm, pose @ np.array([-15.0, 0.0, 0.0]), atol=1e-9)
    np.testing.assert_allclose(went.rod.axis.direction, pose.directions(np.array([0.0, 0.0, 1.0])), atol=1e-9)
