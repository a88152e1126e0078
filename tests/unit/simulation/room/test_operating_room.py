"""The room while a case goes on."""

import numpy as np
import pytest

from shared.geometry.frames import RobotBase, RobotTop
from shared.geometry.transform import Transform
from simulation.room.c_arm import OutOfReach
from simulation.room.faults import RoomFaults
from simulation.room.operating_room import OperatingRoom
from simulation.scenario.c_arm_angles import CArmAngles
from simulation.world.poses import starting_state
from tests.unit.simulation import rooms


def room() -> OperatingRoom:
    scenario = rooms.scenario()
    return OperatingRoom(scenario, lambda: starting_state(scenario).platform)


def test_it_starts_as_the_scenario_says() -> None:
    started = room()
    assert started.angles == starting_state(rooms.scenario()).angles
    assert started.wires == ()
    assert started.drills == ()


def test_it_asks_for_the_platform_each_time() -> None:
    positions: list[Transform[RobotBase, RobotTop]] = [
        Transform.from_rotvec(np.zeros(3), [0.0, 0.0, z]) for z in (40.0, 41.0)
    ]
    asked = OperatingRoom(rooms.scenario(), lambda: positions.pop(0))
    first, second = asked.world(), asked.world()
    shift = second.beam_from_guide.translation_mm - first.beam_from_guide.translation_mm
    assert np.linalg.norm(shift) == pytest.approx(1.0)


def test_wires_come_and_go() -> None:
    with_wires = room()
    with_wires.insert_wires(("distal", "proximal"))
    with_wires.insert_wires(("distal",))
    assert [w.hole_id for w in with_wires.wires] == ["proximal", "distal"]
    assert len(with_wires.state().wires) == 2
    with_wires.remove_wires()
    assert with_wires.state().wires == ()


def test_drilled_holes_stay_and_each_drilling_has_its_own_force() -> None:
    drilled = room()
    first, second = drilled.drill("distal"), drilled.drill("distal")
    assert first.deflection_mm != second.deflection_mm
    assert len(drilled.drills) == len(drilled.state().drilled) == 2


def test_the_c_arm_has_limits() -> None:
    with pytest.raises(OutOfReach, match=r"would stand at 0\.0° orbital and 85\.0° angular, it reaches ±180° and ±80°"):
        room().turn_c_arm(CArmAngles(0.0, 85.0))


def test_faults_act_until_they_are_replaced() -> None:
    faulty = room()
    faulty.set_faults(RoomFaults(nail_present=False, ring_shift_mm=3.0))
    assert not faulty.state().nail_present
    assert faulty.state().ring_shift_mm == 3.0
    faulty.set_faults(RoomFaults())
    assert faulty.state().nail_present


def test_shots_are_counted_and_differ_in_noise() -> None:
    shooting = room()
    (first, _, one), (second, _, two) = shooting.shoot(), shooting.shoot()
    assert (first, second) == (1, 2)
    assert not np.array_equal(one.pixels, two.pixels)


def test_images_of_a_film_differ_by_their_noise_and_look_like_shots() -> None:
    place = room().angles
    filmed = list(room().film([place], 2))
    assert [number for number, _, _ in filmed] == [1, 2]
    first, second = (shot.pixels.astype(float) for _, _, shot in filmed)
    assert not np.array_equal(first, second)
    _, _, shot = room().shoot()
    assert np.array_equal(first, shot.pixels)
