"""Checks of images, each at its limit."""

from dataclasses import replace

import numpy as np
import pytest

from services.imaging.core.acceptance import BALLS_MEASURED, CLIPPED
from services.imaging.core.ball_measurement import UprightImage
from services.imaging.core.camera_model import SourceAndField
from services.imaging.core.checks import (
    balls_needed,
    calibration_reasons,
    clipped_reason,
    motion_reason,
    too_few_reason,
    unusable_reason,
)
from services.imaging.core.joint_estimate import Gauge
from shared.acceptance import at_least
from shared.errors import ReasonCode
from shared.geometry.calibration import BallCandidates
from shared.geometry.camera import DisplacementField
from shared.xray.aperture import UsableArea
from shared.xray.discs import Array, FloatImage
from shared.xray.measurement import BallMeasurements, Discs
from shared.xray.pixel_scale import USUAL_PIXEL_MM
from tests.unit.services.imaging.moved_balls import balls, moved_image
from tests.unit.services.imaging.synthetic import default_ring

EVERYWHERE = np.ones((300, 300), dtype=bool)
BLANK = np.zeros((500, 600), dtype=np.float32)
CENTRE = np.array([299.5, 249.5])


def measurements(seen: int) -> BallMeasurements:
    count = len(default_ring().balls)
    ones = np.ones(count)
    return BallMeasurements(
        np.arange(count) < seen, np.zeros((count, 2)), ones, ones, ones, np.zeros(count, dtype=bool), 1.0
    )


@pytest.mark.parametrize(("side", "levels", "found"), [(300, 16, None), (255, 400, "pixels"), (300, 15, "grey values")])
def test_images_are_refused_below_their_limits_of_size_and_levels(side: int, levels: int, found: str | None) -> None:
    pixels = (np.arange(side * 300) % levels).reshape(side, 300).astype(np.float32)
    reason = unusable_reason(pixels, EVERYWHERE[:side])
    if found is None:
        assert reason is None
    else:
        assert reason is not None
        assert reason.code is ReasonCode.IMAGE_UNUSABLE
        assert found in reason.message


def test_the_grey_values_of_a_small_usable_area_are_all_counted() -> None:
    pixels = (np.arange(90_000) % 16).reshape(300, 300).astype(np.float32)
    few = np.zeros((300, 300), dtype=bool)
    few[:20] = True
    assert unusable_reason(pixels, few) is None


def test_values_that_are_no_numbers_are_refused() -> None:
    pixels = np.random.default_rng(1).uniform(0.0, 1.0, (300, 300)).astype(np.float32)
    pixels[5, 5] = np.nan
    reason = unusable_reason(pixels, EVERYWHERE)
    assert reason is not None
    assert reason.code is ReasonCode.IMAGE_UNUSABLE
    assert "not finite" in reason.message


@pytest.mark.parametrize(("percent", "refused"), [(59, False), (61, True)])
def test_clipped_images_are_refused_with_share_limit_and_remedy(percent: int, *, refused: bool) -> None:
    values = np.linspace(1.0, 2.0, 10_000).astype(np.float32)
    values[: 100 * percent] = 2.0
    reason = clipped_reason(values, CLIPPED)
    assert (reason is not None) is refused
    if reason is not None:
        assert reason.code is ReasonCode.SATURATED
        assert "pure black or white covers 61 % (limit 60 %) of the image; lower" in reason.message


def test_the_balls_needed_are_a_share_of_the_ring_rounded_up() -> None:
    assert balls_needed(BALLS_MEASURED, default_ring()) == 48
    assert balls_needed(replace(BALLS_MEASURED, limit=at_least(0.401, "%", 1)), default_ring()) == 49


def test_too_few_measured_balls_are_refused() -> None:
    ring = default_ring()
    assert too_few_reason(measurements(48), ring) is None
    reason = too_few_reason(measurements(47), ring)
    assert reason is not None
    assert reason.code is ReasonCode.RING_TOO_FEW_BALLS
    assert "47 of the ring's 120 balls could be measured (at least 48)" in reason.message


def upright(pixels: FloatImage, pixel_mm: float = USUAL_PIXEL_MM) -> UprightImage:
    area = UsableArea(np.ones(pixels.shape, dtype=bool), None)
    none = np.zeros(0)
    return UprightImage(
        pixels, area, False, BallCandidates(np.zeros((0, 2)), none, none, none, np.zeros(0, np.int64)), 50.0, pixel_mm
    )


def measured_and_expected() -> tuple[BallMeasurements, Discs]:
    """Balls 0-7 were measured; of 8-12 the prediction alone is right; three touch other discs. Other places are off."""
    centre, radius = balls()
    nowhere = np.full_like(centre, 1e4)
    seen = np.arange(16) < 8
    ones = np.ones(16)
    measured = np.where(seen[:, None], centre, nowhere)
    expected = np.where((seen | (np.arange(16) >= 13))[:, None], nowhere, centre)
    return BallMeasurements(seen, measured, ones, radius, ones, np.arange(16) >= 13, 1.0), Discs(expected, radius)


def test_balls_that_are_smeared_are_refused_whether_or_not_they_could_be_measured() -> None:
    assert motion_reason(upright(moved_image(3.5, 20.0)), *measured_and_expected()) is None
    reason = motion_reason(upright(moved_image(4.6, 20.0)), *measured_and_expected())
    assert reason is not None
    assert reason.code is ReasonCode.MOTION_BLUR
    assert "px (limit 4 px); hold leg and C-arm still" in reason.message


def test_the_background_of_a_smeared_ball_is_as_wide_as_the_pixels_are_fine() -> None:
    # In pixels a sixteenth as large it reaches beyond this image for every ball.
    assert motion_reason(upright(moved_image(4.6, 20.0), USUAL_PIXEL_MM / 16.0), *measured_and_expected()) is None


def model(source_sd_mm: tuple[float, float, float] = (1.0, 1.0, 1.0), at_px: Array = CENTRE) -> SourceAndField:
    """A calibration whose distortion is uncertain by 0.6 px within 15 px of a place, and exact elsewhere."""
    nodes = np.stack(np.meshgrid(np.arange(0.0, 601.0, 5.0), np.arange(0.0, 501.0, 5.0)), axis=-1)
    deviation = np.where(np.hypot(*np.moveaxis(nodes - at_px, -1, 0)) < 15.0, 0.6, 0.0)
    field = DisplacementField(np.zeros(2), 5.0, np.zeros_like(nodes), deviation)
    return SourceAndField(
        np.array([0.0, 0.0, -968.0]), np.diag(np.square(source_sd_mm)), Gauge(4.0, np.eye(2), np.zeros(2)), field
    )


def reasons_against(calibration: SourceAndField, ring_spread_mm: float = 0.02) -> list[str]:
    found = calibration_reasons(upright(BLANK), *measured_and_expected(), calibration, ring_spread_mm)
    assert {reason.code for reason in found} <= {ReasonCode.CALIBRATION_EXTRAPOLATED}
    return [reason.message for reason in found]


@pytest.mark.parametrize("direction_deg", range(0, 360, 30))
def test_distortion_that_is_uncertain_around_the_middle_is_refused(direction_deg: int) -> None:
    angle = np.radians(direction_deg)
    around = np.array([np.cos(angle), np.sin(angle)])
    (message,) = reasons_against(model(at_px=CENTRE + 100.0 * around))
    assert "the image's middle uncertain by 0.60 px (limit 0.5 px)" in message
    assert reasons_against(model(at_px=CENTRE + 130.0 * around)) == []
    assert reasons_against(model(at_px=CENTRE + 70.0 * around)) == []


def test_a_focal_spot_that_is_uncertain_in_any_direction_is_refused() -> None:
    assert reasons_against(model((5.0, 1.0, 2.0))) == []
    (message,) = reasons_against(model((5.1, 1.0, 2.0)))
    assert "and the focal spot by 5.1 mm (limit 5 mm)" in message


def test_a_calibration_that_displaced_balls_leave_uncertain_asks_for_the_ring() -> None:
    (as_filed,) = reasons_against(model((5.1, 1.0, 2.0)), ring_spread_mm=0.07)
    (displaced,) = reasons_against(model((5.1, 1.0, 2.0)), ring_spread_mm=0.12)
    assert "uncover the ring" in as_filed
    assert "the ring's balls lie 0.12 mm (rms per axis) from where its file has them; measure the ring" in displaced
    assert "uncover" not in displaced
    assert reasons_against(model((5.0, 1.0, 2.0)), ring_spread_mm=0.12) == []


def test_a_smeared_image_is_refused_with_its_calibration() -> None:
    found = calibration_reasons(upright(moved_image(4.6, 20.0)), *measured_and_expected(), model((5.1, 1.0, 2.0)), 0.0)
    assert [reason.code for reason in found] == [ReasonCode.MOTION_BLUR, ReasonCode.CALIBRATION_EXTRAPOLATED]
