"""Checks of images, each at its limit."""

from dataclasses import replace

import numpy as np
import pytest

from services.imaging.core.acceptance import BALLS_MEASURED, CLIPPED
from services.imaging.core.checks import balls_needed, clipped_reason, too_few_reason, unusable_reason
from shared.acceptance import at_least
from shared.errors import ReasonCode
from shared.xray.measurement import BallMeasurements
from tests.unit.services.imaging.synthetic import default_ring

EVERYWHERE = np.ones((300, 300), dtype=bool)


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
