"""Differences of two poses."""

from dataclasses import replace

import pytest

from services.robot.core.deviation import Deviation, deviation
from shared.geometry.hexapod import ZERO_POSE, PlatformPose


def test_deviation_is_a_distance_and_an_angle_and_nan_exceeds() -> None:
    off = deviation(PlatformPose(3.0, 4.0, 0.0, 0.0, 0.0, 0.0), PlatformPose(0.0, 0.0, 0.0, 3.0, 0.0, 0.0))
    assert off.distance_mm == pytest.approx(5.0)
    assert off.angle_deg == pytest.approx(3.0)
    assert deviation(ZERO_POSE, replace(ZERO_POSE, u_deg=float("nan"))).exceeds(Deviation(1e9, 1e9))
