"""The map of the workspace."""

import numpy as np
import pytest

from shared.geometry.hexapod import HexapodPart, PlatformPose
from shared.geometry.hexapod_limits import limit_violations
from shared.geometry.hexapod_workspace import UNREACHABLE, WorkspaceMap, travel_range, workspace_map
from shared.parts.hexapod_file import default_hexapod

GRID_MM = np.arange(-24.0, 25.0, 8.0)
ANGLES_DEG = np.array([2.0, 4.0, 30.0])


@pytest.fixture(scope="module")
def hexapod() -> HexapodPart:
    return default_hexapod()


@pytest.fixture(scope="module")
def found(hexapod: HexapodPart) -> WorkspaceMap:
    return workspace_map(hexapod, np.zeros(3), (GRID_MM, GRID_MM, GRID_MM), ANGLES_DEG, directions=8)


def test_every_pose_was_looked_at(found: WorkspaceMap) -> None:
    assert found.poses == 7**3 * (1 + 3 * 8)
    assert set(np.unique(found.free_tilt_deg)) <= {UNREACHABLE, 0.0, 2.0, 4.0, 30.0}


def test_the_map_agrees_with_the_limits_of_single_poses(hexapod: HexapodPart, found: WorkspaceMap) -> None:
    positions = np.stack(np.meshgrid(GRID_MM, GRID_MM, GRID_MM, indexing="ij"), axis=-1).reshape(-1, 3)
    for (x, y, z), tilt_deg in zip(positions, found.free_tilt_deg.ravel(), strict=True):
        pose = PlatformPose(x, y, z, 0.0, 0.0, 0.0)
        level = limit_violations(hexapod, pose, np.zeros(3)) == ()
        assert level is bool(tilt_deg >= 0.0), pose


def test_the_middle_turns_freely_and_the_corners_are_out_of_reach(found: WorkspaceMap) -> None:
    assert found.free_tilt_deg[3, 3, 3] == 4.0
    assert found.free_tilt_deg[0, 0, 0] == UNREACHABLE


def test_volumes_shrink_with_the_tilt_asked_for(found: WorkspaceMap) -> None:
    cell_mm3 = 8.0**3
    assert found.volume_mm3(0.0) == cell_mm3 * np.count_nonzero(found.free_tilt_deg >= 0.0)
    assert found.volume_mm3(0.0) >= found.volume_mm3(2.0) >= found.volume_mm3(4.0) > 0.0
    assert found.volume_mm3(30.0) == 0.0


def test_the_map_ends_where_the_travel_does(hexapod: HexapodPart) -> None:
    lowest, highest = travel_range(hexapod, np.zeros(3))
    along = np.array([lowest.x_mm - 0.02, lowest.x_mm, 0.0, highest.x_mm, highest.x_mm + 0.02])
    still = np.array([0.0, 1.0])
    row = workspace_map(hexapod, np.zeros(3), (along, still, still), ANGLES_DEG, 4).free_tilt_deg[:, 0, 0]
    assert (row >= 0.0).tolist() == [False, True, True, True, False]
