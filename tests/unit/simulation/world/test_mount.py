"""A mount that yields."""

from dataclasses import replace

import numpy as np
import pytest

from shared.geometry.frames import Guide, RobotBase
from shared.geometry.hexapod import PlatformPose, base_from_top
from shared.geometry.transform import Transform
from simulation.scenario.files import ScenarioFile
from simulation.scenario.sampling import scenario_of_seed
from simulation.scenario.values import MountYield
from simulation.world.mount import yielded_base
from simulation.world.poses import bone_from_guide, starting_state

MOUNT = MountYield(translation_n_per_mm=50.0, rotation_nm_per_deg=2.0, tissue_n_per_mm=5.0)
AT_REST: Transform[RobotBase, Guide] = Transform.from_rotvec(np.zeros(3), [60.0, 0.0, 63.0])


def test_where_it_was_mounted_nothing_yields() -> None:
    base = yielded_base(MOUNT, AT_REST, AT_REST)
    np.testing.assert_allclose(base.matrix, np.eye(4), atol=1e-15)


def test_a_move_of_2_mm_is_pushed_back_as_worked_out_by_hand() -> None:
    # 2 mm in y: 10 N back. 10 N / 50 N/mm = 0.2 mm. Moment (60, 2, 63) x (0, -10, 0) = (630, 0, -600) Nmm: 0.315 and
    # -0.3 degrees at 2000 Nmm a degree.
    now: Transform[RobotBase, Guide] = Transform.from_rotvec(np.zeros(3), [60.0, 2.0, 63.0])
    base = yielded_base(MOUNT, AT_REST, now)
    np.testing.assert_allclose(base.translation_mm, [0.0, -0.2, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.degrees(base.rotation_vector_rad), [0.315, 0.0, -0.3], atol=1e-12)


def test_in_the_room_a_yielding_mount_moves_the_guide_back() -> None:
    stiff = scenario_of_seed(4)
    soft = replace(stiff, mount_yield=MOUNT)
    hexapod = stiff.parts.hexapod
    platform = base_from_top(hexapod, PlatformPose(0.0, 2.0, 0.0, 0.0, 0.0, 0.0), hexapod.pivot_mm)
    moved = replace(starting_state(stiff), platform=platform)
    start = bone_from_guide(stiff, starting_state(stiff)).translation_mm
    way_stiff = np.linalg.norm(bone_from_guide(stiff, moved).translation_mm - start)
    way_soft = np.linalg.norm(bone_from_guide(soft, moved).translation_mm - start)
    assert way_stiff == pytest.approx(2.0)
    assert 0.8 < way_soft < 1.9


def test_a_scenario_file_may_have_one() -> None:
    file = ScenarioFile.model_validate(
        {
            "schema": "distalock/scenario/1",
            "seed": 1,
            "mount_yield": {"translation_n_per_mm": 50.0, "rotation_nm_per_deg": 2.0, "tissue_n_per_mm": 5.0},
        }
    )
    assert file.mount_yield is not None
    assert file.mount_yield.tissue_n_per_mm == 5.0
