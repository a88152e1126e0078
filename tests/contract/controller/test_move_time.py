"""The robot service and the virtual controller agree on how long a move takes, also when it is mostly a turn."""

import numpy as np
import pytest

from services.robot.core.tuning import PLAN_TOLERANCES
from shared.parts.hexapod_file import default_hexapod
from simulation.controller.moves import Purpose, move_between


@pytest.mark.parametrize(("distance_mm", "angle_deg"), [(8.0, 0.5), (2.0, 6.0), (0.3, 6.0), (0.0, 3.0)])
def test_a_move_ends_when_the_robot_service_expects_it(distance_mm: float, angle_deg: float) -> None:
    limits = default_hexapod().speed_limits
    expected_s = max(distance_mm / limits.translation_mm_per_s, angle_deg / limits.rotation_deg_per_s)
    velocity_mm_per_s = max(distance_mm / expected_s, PLAN_TOLERANCES.slowest_mm_per_s)
    end = np.array([distance_mm, 0.0, 0.0, 0.0, angle_deg, 0.0])
    move = move_between(np.zeros(6), end, limits, velocity_mm_per_s, Purpose.TARGET)
    assert move is not None
    assert expected_s - 1e-9 <= move.profile.duration_s <= expected_s + 0.5
