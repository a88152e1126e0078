"""Standard deviations against poses that err as far as they may, drawn and counted."""

import numpy as np
import pytest

from shared.geometry.hexapod_accuracy import (
    LARGEST_ERROR_DEG,
    LARGEST_ERROR_MM,
    MOVE_SD_DEG,
    MOVE_SD_MM,
    POSE_SD_DEG,
    POSE_SD_MM,
)

SEED = 5


def test_standard_deviations_are_those_of_waves_within_the_bounds() -> None:
    print(f"seed {SEED}")
    phases = np.random.default_rng(SEED).uniform(0.0, 2.0 * np.pi, (2, 20_000, 3))
    off_mm = LARGEST_ERROR_MM / np.sqrt(3.0) * np.sin(phases)
    off_deg = LARGEST_ERROR_DEG * np.sin(phases)
    assert np.linalg.norm(off_mm, axis=-1).max() <= LARGEST_ERROR_MM
    for off, pose_sd, move_sd in ((off_mm, POSE_SD_MM, MOVE_SD_MM), (off_deg, POSE_SD_DEG, MOVE_SD_DEG)):
        assert np.std(off[0], axis=0) == pytest.approx(pose_sd, rel=0.02)
        assert np.std(off[1] - off[0], axis=0) == pytest.approx(move_sd, rel=0.02)
