"""The paper's axis rule and nail: accepts round holes and takes the camera's axis, refuses lenses."""

import numpy as np
import pytest

from baselines.fronto_parallel.axis_rule import LOWEST_ASPECT_RATIO, FrontoParallelNail, SeenNail, along_the_beam
from baselines.fronto_parallel.nail import locate_nail_by_band
from services.registration.core.nail.search.find import find_nail
from shared.errors import Accepted, ReasonCode, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.lines import angle_between_rad
from tests.unit.services.registration.xray_scene import (
    Scene,
    calibration,
    nail_part,
    pincushion,
    posed_nail,
    render,
)

SIZE_PX = 560
NO_BALLS = np.zeros((0, 3))


def located(
    tilt_deg: tuple[float, float], at_mm: tuple[float, float, float], view: CArmCalibration | None = None
) -> Accepted[FrontoParallelNail] | Rejected:
    view = calibration(SIZE_PX) if view is None else view
    pose = posed_nail(35.0, tilt_deg, at_mm)
    pixels = render(Scene(SIZE_PX, nail_part(), pose), view, seed=21)
    return locate_nail_by_band(pixels, view, nail_part(), pose.rotation[:, 0], NO_BALLS)


def test_round_holes_have_the_cameras_axis() -> None:
    result = located((0.0, 0.0), (2.0, -1.0, 740.0))
    assert isinstance(result, Accepted), result
    pose = result.value.camera_from_nail
    assert pose.rotation[:, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    assert pose.rotation[:, 0] == pytest.approx(posed_nail(35.0).rotation[:, 0], abs=0.01)
    assert pose.translation_mm == pytest.approx([2.0, -1.0, 740.0], abs=6.0)
    assert pose.translation_mm[:2] == pytest.approx([2.0, -1.0], abs=0.2)
    assert min(result.value.circularity) >= LOWEST_ASPECT_RATIO


def test_distortion_is_taken_out_before_edges_are_looked_for() -> None:
    view = calibration(SIZE_PX, pincushion(SIZE_PX, 0.06))
    result = located((0.0, 0.0), (14.0, -9.0, 740.0), view)
    assert isinstance(result, Accepted), result
    assert result.value.camera_from_nail.translation_mm[:2] == pytest.approx([14.0, -9.0], abs=0.2)


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


def test_without_a_guide_it_cannot_tell_which_end_is_distal() -> None:
    view = calibration(SIZE_PX)
    pixels = render(Scene(SIZE_PX, nail_part(), posed_nail(35.0)), view, seed=21)
    result = locate_nail_by_band(pixels, view, nail_part(), None, NO_BALLS)
    assert isinstance(result, Rejected)
    assert result.reasons[0].code is ReasonCode.NAIL_NOT_FOUND
    assert "which end is distal" in result.reasons[0].message


def test_an_image_without_a_nail_has_no_band() -> None:
    view = calibration(SIZE_PX)
    empty = render(Scene(SIZE_PX), view, seed=22)
    result = locate_nail_by_band(empty, view, nail_part(), np.array([1.0, 0.0, 0.0]), NO_BALLS)
    assert isinstance(result, Rejected)
    assert result.reasons[0].code is ReasonCode.NAIL_NOT_FOUND


def test_a_nail_without_holes_has_none_visible() -> None:
    view, pose = calibration(SIZE_PX), posed_nail(35.0)
    solid = render(Scene(SIZE_PX, nail_part(hole_x_mm=()), pose), view, seed=23)
    result = locate_nail_by_band(solid, view, nail_part(), pose.rotation[:, 0], NO_BALLS)
    assert isinstance(result, Rejected)
    assert result.reasons[0].code is ReasonCode.HOLE_NOT_VISIBLE


def test_the_rule_serves_the_projects_own_search_too() -> None:
    view, pose = calibration(SIZE_PX), posed_nail(35.0)
    pixels = render(Scene(SIZE_PX, nail_part(), pose), view, seed=21)
    start = find_nail(pixels, view, nail_part(), pose.rotation[:, 0])
    assert isinstance(start, Accepted)
    result = along_the_beam(SeenNail.of_start(start.value), view, nail_part())
    assert isinstance(result, Accepted)
    assert result.value.camera_from_nail.translation_mm[:2] == pytest.approx([0.0, 0.0], abs=0.2)
