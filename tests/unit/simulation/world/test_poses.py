"""Where everything is: chains of transforms, and what moves with what."""

from dataclasses import replace

import numpy as np
import pytest

from shared.geometry.hexapod import PlatformPose, base_from_top
from shared.geometry.lines import angle_between_rad
from simulation.render.truth import guide_axis_errors, hole_truths
from simulation.scenario.c_arm_angles import CArmAngles, angles_of_beam, c_arm_rotation
from simulation.world.poses import principal_point_px, starting_state, world_at
from tests.unit.simulation import rooms


@pytest.mark.parametrize(("orbital", "angular"), [(0.0, 0.0), (-90.0, 5.0), (87.0, -12.0), (30.0, 40.0)])
def test_angles_point_the_beam_and_are_found_again(orbital: float, angular: float) -> None:
    beam = c_arm_rotation(CArmAngles(orbital, angular), roll_deg=33.0)[:, 2]
    found = angles_of_beam(beam)
    assert (found.orbital_deg, found.angular_deg) == pytest.approx((orbital, angular))


def test_a_lateral_beam_is_horizontal_and_a_frontal_one_vertical() -> None:
    # Room: x to the feet, y to the left, z up.
    np.testing.assert_allclose(c_arm_rotation(CArmAngles(0.0, 0.0), 0.0)[:, 2], [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(c_arm_rotation(CArmAngles(-90.0, 0.0), 0.0)[:, 2], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(c_arm_rotation(CArmAngles(0.0, 90.0), 0.0)[:, 2], [1.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_guide_sees_the_nail_the_same_from_every_angle(seed: int) -> None:
    print(f"seed {seed}")
    scenario = rooms.scenario(seed)
    state = starting_state(scenario)
    turned = replace(state, angles=CArmAngles(state.angles.orbital_deg + 35.0, state.angles.angular_deg - 10.0))
    before, after = world_at(scenario, state), world_at(scenario, turned)
    np.testing.assert_allclose(before.guide_from_nail.matrix, after.guide_from_nail.matrix, atol=1e-9)
    assert np.linalg.norm(before.beam_from_nail.matrix - after.beam_from_nail.matrix) > 0.1


def test_moving_the_platform_moves_the_guide_and_nothing_else() -> None:
    scenario = rooms.scenario()
    hexapod = scenario.parts.hexapod
    state = starting_state(scenario)
    moved_to = PlatformPose(1.0, -2.0, 0.5, 0.0, 0.0, 0.0)
    moved = replace(state, platform=base_from_top(hexapod, moved_to, hexapod.pivot_mm))
    before, after = world_at(scenario, state), world_at(scenario, moved)
    np.testing.assert_allclose(before.beam_from_nail.matrix, after.beam_from_nail.matrix)
    shift = after.beam_from_guide.translation_mm - before.beam_from_guide.translation_mm
    assert np.linalg.norm(shift) == pytest.approx(np.sqrt(1.0 + 4.0 + 0.25))


def test_a_slipped_mount_moves_the_guide() -> None:
    scenario = rooms.scenario()
    state = starting_state(scenario)
    slipped = replace(state, mount_shift_mm=(0.0, 3.0, 0.0))
    shift = (
        world_at(scenario, slipped).beam_from_guide.translation_mm
        - world_at(scenario, state).beam_from_guide.translation_mm
    )
    assert np.linalg.norm(shift) == pytest.approx(3.0)


def test_a_slipped_ring_moves_along_the_columns() -> None:
    scenario = rooms.scenario()
    state = starting_state(scenario)
    shift = (
        world_at(scenario, replace(state, ring_shift_mm=4.0)).beam_from_ring.translation_mm
        - world_at(scenario, state).beam_from_ring.translation_mm
    )
    np.testing.assert_allclose(shift, [4.0, 0.0, 0.0], atol=1e-9)


def test_the_principal_point_wanders_with_the_angle() -> None:
    scenario = rooms.scenario()
    start = starting_state(scenario).angles
    turned = CArmAngles(start.orbital_deg + 90.0, start.angular_deg)
    shift_mm = (principal_point_px(scenario, turned) - principal_point_px(scenario, start)) * scenario.c_arm.pixel_mm
    assert np.all((np.abs(shift_mm) >= 5.0) & (np.abs(shift_mm) <= 15.0))


@pytest.mark.parametrize("seed", range(6))
def test_at_the_start_everything_is_where_an_operating_room_has_it(seed: int) -> None:
    print(f"seed {seed}")
    scenario = rooms.scenario(seed)
    world = world_at(scenario, starting_state(scenario))
    nail, guide = world.beam_from_nail.translation_mm, world.beam_from_guide.translation_mm
    assert 195.0 < scenario.c_arm.source_to_detector_mm - nail[2] < 305.0
    assert 85.0 < nail[2] - guide[2] < 130.0
    assert np.linalg.norm(nail[:2]) < 20.0
    tilt = angle_between_rad(world.beam_from_nail.directions(np.array([0.0, 0.0, 1.0])), np.array([0.0, 0.0, 1.0]))
    assert np.degrees(tilt) + 1e-9 >= 0.5
    assert np.degrees(tilt) <= 8.0 + 1e-9


def test_errors_of_an_aligned_guide_are_zero_and_of_a_shifted_one_the_shift() -> None:
    scenario = rooms.scenario()
    placement = scenario.placement
    head = scenario.parts.hexapod.top_from_guide(scenario.head_extension_mm)
    nail_from_guide = world_at(scenario, starting_state(scenario)).guide_from_nail.inverse()
    for shift_mm in (0.0, 1.25):
        matrix = np.eye(4)
        matrix[:3, 3] = [0.0, shift_mm, -110.0]
        target = type(nail_from_guide).from_matrix(matrix)
        platform = placement.bone_from_base.inverse() @ placement.bone_from_nail @ target @ head.inverse()
        world = world_at(scenario, replace(starting_state(scenario), platform=platform))
        for error in guide_axis_errors(scenario, world):
            assert error.entry_offset_mm == pytest.approx(shift_mm, abs=1e-9)
            assert error.angle_deg == pytest.approx(0.0, abs=1e-6)
        distal = next(h for h in hole_truths(scenario, world) if h.id == "distal")
        np.testing.assert_allclose(distal.entry_point_guide_mm, [15.0, -shift_mm, 110.0 - 5.5], atol=1e-9)
        np.testing.assert_allclose(distal.axis_guide, [0.0, 0.0, 1.0], atol=1e-9)
