"""Images of which only what moved is traced again: the same, bit by bit, as when all of it is."""

from dataclasses import replace

import numpy as np
import pytest

from shared.geometry.frames import RobotTop
from shared.geometry.transform import Transform
from simulation.render.primary import trace
from simulation.render.retracing import Retracing
from simulation.render.scene import balls_in_view, pack_scene
from simulation.room.drilling import insert_wire
from simulation.scenario.sampling import scenario_of_seed
from simulation.scenario.values import Scenario
from simulation.world.poses import World, WorldState, starting_state, world_at

SIZE_PX = 128


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    whole = scenario_of_seed(4)
    factor = whole.c_arm.size_px / SIZE_PX
    c_arm = replace(whole.c_arm, size_px=SIZE_PX, pixel_mm=whole.c_arm.pixel_mm * factor)
    return replace(whole, c_arm=c_arm)


def moved(state: WorldState, x_mm: float) -> WorldState:
    """The robot has moved the guide, and turned it a little."""
    step: Transform[RobotTop, RobotTop] = Transform.from_rotvec(np.array([0.0, 0.01, 0.02]), np.array([x_mm, 1.0, 0.5]))
    return replace(state, platform=state.platform @ step)


def seen(scenario: Scenario, state: WorldState, rays: Retracing) -> tuple[np.ndarray, np.ndarray]:
    """The image with rays that are kept, and with all of them traced."""
    world: World = world_at(scenario, state)
    packed = pack_scene(scenario, world, balls_in_view(scenario, world))
    return rays.primary(scenario, world, packed), trace(scenario, world, packed).primary


def test_an_image_after_a_move_is_the_same_as_one_traced_whole(scenario: Scenario) -> None:
    rays, state = Retracing(), starting_state(scenario)
    first, _ = seen(scenario, state, rays)
    for x_mm in (1.5, -3.0):
        state = moved(state, x_mm)
        retraced, whole = seen(scenario, state, rays)
        np.testing.assert_array_equal(retraced, whole)
        assert not np.array_equal(retraced, first), "the guide has moved, and shows it"


def test_wires_that_come_and_go_leave_the_same_image(scenario: Scenario) -> None:
    rays, state = Retracing(), starting_state(scenario)
    seen(scenario, state, rays)
    hole = scenario.parts.guide.holes[0].id
    wired = replace(state, wires=(insert_wire(scenario, state, hole).rod,))
    for one in (wired, state, replace(state, guide_present=False), wired):
        retraced, whole = seen(scenario, one, rays)
        np.testing.assert_array_equal(retraced, whole)


def test_another_place_of_the_c_arm_is_traced_whole(scenario: Scenario) -> None:
    rays, state = Retracing(), starting_state(scenario)
    seen(scenario, state, rays)
    turned = replace(state, angles=replace(state.angles, orbital_deg=state.angles.orbital_deg + 2.0))
    retraced, whole = seen(scenario, turned, rays)
    np.testing.assert_array_equal(retraced, whole)
