"""What the holes hold makes the tilt uncertain, and nothing else does: fits of filled holes."""

from functools import cache
from unittest.mock import Mock

import numpy as np
import pytest

from services.registration.core.nail import image_fit
from services.registration.core.nail.fit import measure_nail
from services.registration.core.nail.image_fit import NailFit
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.region import FitInput
from shared.errors import Accepted
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import angle_between_rad
from shared.geometry.transform import Transform
from tests.unit.services.registration.rendered_case import CAMERA_FROM_NAIL, SIZE_PX, rendered_parts, turned_nail
from tests.unit.services.registration.xray_scene import Scene, calibration, nail_part, render

NAIL = nail_part(material="Ti6Al4V")


@cache
def fitted(per_mm: float, rise: tuple[float, float] = (0.0, 0.0)) -> NailFit:
    """The fit of a titanium nail whose holes hold something, towards one wall more by a rise."""
    view = calibration(SIZE_PX)
    scene = Scene(SIZE_PX, NAIL, CAMERA_FROM_NAIL, hole_content_per_mm=per_mm, content_rise=rise)
    given = FitInput(render(scene, view, 5), view, NAIL, Occluders(None, rendered_parts().ring))
    found = measure_nail(given, turned_nail((3.0, -1.5)))
    assert isinstance(found, Accepted)
    return found.value


def axis_error_deg(fit: NailFit, truth: Transform[Camera, Nail] = CAMERA_FROM_NAIL) -> float:
    z = np.array([0.0, 0.0, 1.0])
    return float(np.degrees(angle_between_rad(fit.camera_from_nail.directions(z), truth.directions(z))))


def test_holes_that_hold_what_is_beside_the_nail_leave_the_tilt_as_certain_as_it_was() -> None:
    assert fitted(0.0).content_turn_deg < 0.03


@pytest.mark.requirement("REG-06")
def test_bone_in_the_holes_makes_the_tilt_uncertain_by_about_what_it_turns_it() -> None:
    fit = fitted(0.06)
    assert 0.4 * axis_error_deg(fit) < fit.content_turn_deg < 2.0 * axis_error_deg(fit)


@pytest.mark.parametrize("rise", [(0.0, 0.05), (0.0, -0.05)])
def test_content_beside_one_wall_makes_the_tilt_uncertain_by_what_it_turns_it(rise: tuple[float, float]) -> None:
    fit = fitted(0.025, rise)  # the same noise as without: what turns it is the content alone
    assert fit.content_turn_deg == pytest.approx(axis_error_deg(fit, fitted(0.0).camera_from_nail), rel=0.35)


def test_the_covariance_by_content_is_of_an_error_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    motion = np.array([0.01, -0.02, 0.0, 0.1, 0.2, -0.3])
    monkeypatch.setattr(image_fit, "covariance_by_content", Mock(return_value=np.outer(motion, motion)))
    added = fitted.__wrapped__(0.0).errors.covariance - fitted(0.0).errors.covariance
    np.testing.assert_allclose(added[:6, :6], np.outer(motion, motion), rtol=0.02, atol=1e-4)


@pytest.mark.requirement("REG-06")
@pytest.mark.parametrize(("per_mm", "rise"), [(-0.015, (0.0, 0.0)), (0.0, (0.03, 0.0))])
def test_openings_brighter_than_the_background_make_the_tilt_as_uncertain_as_bores_in_the_bone_would(
    per_mm: float, rise: tuple[float, float]
) -> None:
    assert 0.5 < fitted(per_mm, rise).content_turn_deg < 1.2
