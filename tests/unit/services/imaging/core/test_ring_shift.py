from dataclasses import replace

import pytest

from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.ring_shift import ring_shift
from services.imaging.devices.c_arm_memory import CArmMemory
from services.imaging.devices.position_store import PositionStore
from shared.errors import Accepted
from shared.geometry.calibration import CArmCalibration
from tests.unit.services.imaging.synthetic import Scene, default_ring, render

SCENE = Scene(seed=70, others=4)


def calibration_of(scene: Scene) -> CArmCalibration:
    outcome = calibrate_image(render(scene, default_ring()).pixels, default_ring(), NominalGeometry())
    assert isinstance(outcome, Accepted)
    return outcome.value


@pytest.fixture(scope="module")
def before() -> CArmCalibration:
    return calibration_of(SCENE)


def test_another_image_of_the_same_ring_shows_no_shift(before: CArmCalibration) -> None:
    shift = ring_shift(calibration_of(replace(SCENE, seed=71)), before)
    assert shift is not None
    assert shift.translation_mm < 0.05
    assert abs(shift.turn_deg) < 0.05
    assert not shift.beyond_limits


def test_a_turned_ring_is_measured(before: CArmCalibration) -> None:
    shift = ring_shift(calibration_of(replace(SCENE, seed=72, turn_deg=SCENE.turn_deg + 2.0)), before)
    assert shift is not None
    assert shift.turn_deg == pytest.approx(2.0, abs=0.2)
    assert shift.beyond_limits


def test_another_display_says_nothing(before: CArmCalibration) -> None:
    assert ring_shift(replace(before, mirrored=not before.mirrored), before) is None


def test_memory_offers_what_is_nearest(before: CArmCalibration, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("positions")
    memory = CArmMemory(PositionStore(folder))
    assert memory.before("a" * 64, (0.0, 0.0)) is None
    assert memory.after("a" * 64, (0.0, 0.0), before) is None
    assert memory.before("a" * 64, (0.0, 0.0)) is before
    assert memory.before("b" * 64, (0.0, 0.0)) is None
    later = CArmMemory(PositionStore(folder))
    stored = later.before("a" * 64, (1.5, -2.0))
    assert stored is not None
    assert stored.balls_found == before.balls_found
    assert later.before("a" * 64, (30.0, 0.0)) is None
    assert later.before("a" * 64, None) is None


def test_a_damaged_file_is_as_good_as_none(before: CArmCalibration, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("positions")
    PositionStore(folder).put("a" * 64, 0.0, 0.0, before)
    next(folder.iterdir()).write_text("{")
    assert PositionStore(folder).get("a" * 64, 0.0, 0.0) is None
