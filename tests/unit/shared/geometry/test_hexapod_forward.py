"""Forward kinematics of the hexapod."""

import numpy as np
import pytest

from shared.geometry.hexapod import HexapodPart, leg_lengths_mm
from shared.geometry.hexapod_forward import poses_from_leg_lengths
from shared.geometry.hexapod_limits import within_limits
from shared.parts.hexapod_file import default_hexapod


@pytest.fixture(scope="module")
def hexapod() -> HexapodPart:
    return default_hexapod()


@pytest.mark.parametrize("seed", [7])
def test_inverse_then_forward_returns_every_pose_of_the_workspace(hexapod: HexapodPart, seed: int) -> None:
    poses = np.random.default_rng(seed).uniform(-1.0, 1.0, (20000, 6)) * [15.0, 15.0, 8.0, 15.0, 8.0, 20.0]
    inside = poses[within_limits(hexapod, poses, hexapod.pivot_mm)]
    assert len(inside) > 500
    lengths = leg_lengths_mm(hexapod, inside, hexapod.pivot_mm)
    found = poses_from_leg_lengths(hexapod, lengths, hexapod.pivot_mm)
    assert np.abs(found - inside)[:, :3].max() < 1e-9
    assert np.radians(np.abs(found - inside)[:, 3:]).max() < 1e-9


def test_lengths_that_no_pose_has_are_refused(hexapod: HexapodPart) -> None:
    impossible = np.array([[37.0, 37.0, 37.0, 200.0, 37.0, 37.0]])
    with pytest.raises(ValueError, match=r"no pose has the leg lengths .* check the leg encoders"):
        poses_from_leg_lengths(hexapod, impossible, hexapod.pivot_mm)
