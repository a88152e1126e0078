"""What is remembered of a C-arm, from image to image and on disk."""

from pathlib import Path

import pytest

from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from services.imaging.devices.c_arm_memory import CArmMemory
from services.imaging.devices.position_store import PositionStore
from shared.errors import Accepted
from shared.geometry.calibration import CArmCalibration
from tests.unit.services.imaging.synthetic import Scene, default_ring, render


@pytest.fixture(scope="module")
def calibration() -> CArmCalibration:
    outcome = calibrate_image(
        render(Scene(seed=70, others=4), default_ring()).pixels, default_ring(), NominalGeometry()
    )
    assert isinstance(outcome, Accepted)
    return outcome.value


def test_memory_offers_what_is_nearest(calibration: CArmCalibration, tmp_path: Path) -> None:
    memory = CArmMemory(PositionStore(tmp_path))
    assert memory.before("a" * 64, (0.0, 0.0)) is None
    assert memory.after("a" * 64, (0.0, 0.0), calibration) is None
    assert memory.before("a" * 64, (0.0, 0.0)) is calibration
    assert memory.before("b" * 64, (0.0, 0.0)) is None
    later = CArmMemory(PositionStore(tmp_path))
    stored = later.before("a" * 64, (1.5, -2.0))
    assert stored is not None
    assert stored.balls_found == calibration.balls_found
    assert later.before("a" * 64, (30.0, 0.0)) is None
    assert later.before("a" * 64, None) is None


def test_a_damaged_file_is_as_good_as_none(calibration: CArmCalibration, tmp_path: Path) -> None:
    PositionStore(tmp_path).put("a" * 64, 0.0, 0.0, calibration)
    next(tmp_path.iterdir()).write_text("{")
    assert PositionStore(tmp_path).get("a" * 64, 0.0, 0.0) is None
