"""The paper's method: accepts round holes and takes the camera's axis, refuses lenses."""

import numpy as np
import pytest

from services.registration.core.fronto_parallel import (
    LOWEST_ASPECT_RATIO,
    FrontoParallelNail,
    locate_fronto_parallel,
)
from shared.errors import Accepted, ReasonCode, Rejected
from shared.geometry.lines import angle_between_rad
from tests.unit.services.registration.xray_scene import Scene, calibration, nail_part, posed_nail, render

SIZE_PX = 560


def located(
    tilt_deg: tuple[float, float], at_mm: tuple[float, float, float]
) -> Accepted[FrontoParallelNail] | Rejected:
    view = calibration(SIZE_PX)
    pixels = render(Scene(SIZE_PX, nail_part(), posed_nail(35.0, tilt_deg, at_mm)), view, seed=21)
    return locate_fronto_parallel(pixels, view, nail_part())


def test_round_holes_have_the_cameras_axis() -> None:
    result = located((0.0, 0.0), (2.0, -1.0, 740.0))
    assert isinstance(result, Accepted), result
    pose = result.value.camera_from_nail
    assert pose.rotation[:, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    assert pose.translation_mm == pytest.approx([2.0, -1.0, 740.0], abs=3.0)
    assert pose.translation_mm[:2] == pytest.approx([2.0, -1.0], abs=0.2)
    assert min(result.value.circularity) >= LOWEST_ASPECT_RATIO


def test_its_axis_is_wrong_by_the_tilt_it_cannot_see() -> None:
    result = located((1.5, 0.0), (0.0, 0.0, 740.0))
    assert isinstance(result, Accepted), result
    true = posed_nail(35.0, (1.5, 0.0)).rotation[:, 2]
    error_deg = np.degrees(angle_between_rad(result.value.camera_from_nail.rotation[:, 2], true))
    assert error_deg == pytest.approx(1.5, abs=1e-6)


def test_lenses_are_refused_with_their_aspect_ratio() -> None:
    result = located((6.0, 4.0), (0.0, 0.0, 740.0))
    assert isinstance(result, Rejected)
    assert result.reasons[0].code is ReasonCode.TILT_TOO_LARGE
    assert f"(limit {LOWEST_ASPECT_RATIO})" in result.reasons[0].message


def test_what_the_search_refuses_is_refused() -> None:
    view = calibration(SIZE_PX)
    result = locate_fronto_parallel(render(Scene(SIZE_PX), view, seed=22), view, nail_part())
    assert isinstance(result, Rejected)
    assert result.reasons[0].code is ReasonCode.NAIL_NOT_FOUND
