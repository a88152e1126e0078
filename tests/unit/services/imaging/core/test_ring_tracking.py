"""Calibration at the place of an earlier image, and rings that have moved since."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.ring_tracking import calibrate_next, ring_shift, still_dark
from shared.errors import Accepted, ReasonCode, Rejected
from shared.geometry.calibration import CArmCalibration
from tests.unit.services.imaging.synthetic import Rendered, Scene, default_ring, render

FIRST = Scene(seed=50, mirrored=True, turn_deg=75.0)


@pytest.fixture(scope="module")
def before() -> CArmCalibration:
    outcome = calibrate_image(render(FIRST, default_ring()).pixels, default_ring(), NominalGeometry())
    assert isinstance(outcome, Accepted)
    return outcome.value


def accepted(rendered: Rendered, before: CArmCalibration | None) -> CArmCalibration:
    outcome = calibrate_next(rendered.pixels, default_ring(), NominalGeometry(), before)
    assert isinstance(outcome, Accepted), outcome
    return outcome.value


def source_error_mm(calibration: CArmCalibration, rendered: Rendered) -> float:
    error = calibration.camera_from_ring.inverse().translation_mm - rendered.source_mm
    return float(np.hypot(error[0], error[1]) + 0.1 * abs(error[2]))


def test_where_it_was_it_is_measured_as_well_as_searched(before: CArmCalibration) -> None:
    rendered = render(replace(FIRST, seed=51), default_ring())
    followed, searched = accepted(rendered, before), accepted(rendered, None)
    assert followed.mirrored
    assert followed.balls_found >= searched.balls_found - 3
    assert source_error_mm(followed, rendered) < 0.15
    centre = rendered.centre_px[followed.balls.ring_index[followed.balls.ring_index >= 0]]
    error = np.hypot(*(followed.balls.centre_px[followed.balls.ring_index >= 0] - centre).T)
    assert np.median(error) < 0.1


def test_other_discs_are_found_where_they_are_now(before: CArmCalibration) -> None:
    rendered = render(replace(FIRST, seed=52), default_ring())
    others = accepted(rendered, before).balls
    free = others.centre_px[others.ring_index < 0]
    distance = np.hypot(*(rendered.others_px[:, None] - free[None]).transpose(2, 0, 1)).min(axis=1)
    assert np.mean(distance < 1.0) > 0.7


@pytest.mark.parametrize(
    "scene",
    [
        replace(FIRST, seed=53, turn_deg=79.0),
        replace(FIRST, seed=54, source_mm=(14.0, -6.0, -968.0)),
        replace(FIRST, seed=55, mirrored=False, turn_deg=200.0),
    ],
    ids=["turned", "moved", "another display"],
)
def test_a_c_arm_that_moved_is_searched_anew(scene: Scene, before: CArmCalibration) -> None:
    rendered = render(scene, default_ring())
    calibration = accepted(rendered, before)
    assert calibration.mirrored is scene.mirrored
    assert source_error_mm(calibration, rendered) < 0.2


def test_an_image_without_ring_is_refused_whatever_was_before(before: CArmCalibration) -> None:
    pixels = render(replace(FIRST, seed=56, present=0.0), default_ring()).pixels
    outcome = calibrate_next(pixels, default_ring(), NominalGeometry(), before)
    assert isinstance(outcome, Rejected)
    assert [reason.code for reason in outcome.reasons] == [ReasonCode.RING_NOT_FOUND]


def test_an_image_of_another_size_is_searched(before: CArmCalibration) -> None:
    rendered = render(replace(FIRST, seed=57, aperture=False), default_ring())
    part = Rendered(rendered.pixels[:-24], rendered.centre_px, rendered.others_px, rendered.present, rendered.source_mm)
    assert accepted(part, before).height_px == 1000


def test_a_glance_tells_whether_the_ring_is_where_it_was(before: CArmCalibration) -> None:
    def upright(scene: Scene) -> NDArray[np.float32]:
        return np.ascontiguousarray(render(scene, default_ring()).pixels[:, ::-1])

    same = upright(replace(FIRST, seed=58, present=0.8))
    assert still_dark(same, before.balls)
    assert not still_dark(np.asarray(same.max() - same, dtype=np.float32), before.balls)
    assert not still_dark(upright(replace(FIRST, seed=59, turn_deg=79.0)), before.balls)
    assert not still_dark(upright(replace(FIRST, seed=60, present=0.0)), before.balls)


SCENE = Scene(seed=70, others=4)


def calibration_of(scene: Scene) -> CArmCalibration:
    outcome = calibrate_image(render(scene, default_ring()).pixels, default_ring(), NominalGeometry())
    assert isinstance(outcome, Accepted)
    return outcome.value


@pytest.fixture(scope="module")
def first_position() -> CArmCalibration:
    return calibration_of(SCENE)


def test_another_image_of_the_same_ring_shows_no_shift(first_position: CArmCalibration) -> None:
    shift = ring_shift(calibration_of(replace(SCENE, seed=71)), first_position)
    assert shift is not None
    assert shift.translation_mm < 0.05
    assert abs(shift.turn_deg) < 0.05
    assert not shift.beyond_limits


def test_a_turned_ring_is_measured(first_position: CArmCalibration) -> None:
    shift = ring_shift(calibration_of(replace(SCENE, seed=72, turn_deg=SCENE.turn_deg + 2.0)), first_position)
    assert shift is not None
    assert shift.turn_deg == pytest.approx(2.0, abs=0.2)
    assert shift.beyond_limits


def test_another_display_says_nothing(first_position: CArmCalibration) -> None:
    assert ring_shift(replace(first_position, mirrored=not first_position.mirrored), first_position) is None
