"""Whatever the holes hold, the axes stay right, and the background is as loose about them as the image shows."""

from functools import cache

import numpy as np
import pytest

from services.registration.core.nail.hole_content import loosened, stiffness_about_holes
from services.registration.core.nail.image_fit import ImageFit, fit_image
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.region import FitInput
from services.registration.core.tuning import HOLE_CONTENT
from shared.geometry.lines import angle_between_rad
from tests.unit.services.registration.rendered_case import (
    CAMERA_FROM_NAIL,
    SIZE_PX,
    rendered_parts,
    turned_nail,
)
from tests.unit.services.registration.xray_scene import Scene, calibration, nail_part, render

NAIL = nail_part(material="Ti6Al4V")


@cache
def fitted(per_mm: float, rise: tuple[float, float], channel_share: float = 0.0) -> ImageFit:
    """The fit of a titanium nail whose holes hold something, towards one wall more by a rise."""
    view = calibration(SIZE_PX)
    scene = Scene(
        SIZE_PX,
        NAIL,
        CAMERA_FROM_NAIL,
        hole_content_per_mm=per_mm,
        content_rise=rise,
        channel_share=channel_share,
    )
    given = FitInput(render(scene, view, 5), view, NAIL, Occluders(None, rendered_parts().ring))
    found = fit_image(given, turned_nail((3.0, -1.5)))
    assert isinstance(found, ImageFit)
    return found


def axis_error_deg(found: ImageFit) -> float:
    z = np.array([0.0, 0.0, 1.0])
    axis, true_axis = (pose.directions(z) for pose in (found.fit.camera_from_nail, CAMERA_FROM_NAIL))
    return float(np.degrees(angle_between_rad(axis, true_axis)))


def axis_sd_deg(found: ImageFit) -> float:
    return float(np.degrees(np.sqrt(np.trace(found.fit.errors.covariance[:2, :2]))))


@pytest.mark.requirement("REG-06")
@pytest.mark.parametrize(
    ("per_mm", "rise"),
    [
        (0.06, (0.0, 0.0)),
        pytest.param(0.025, (0.0, 0.05), marks=pytest.mark.long),
        pytest.param(0.025, (0.0, -0.05), marks=pytest.mark.long),
        pytest.param(-0.015, (0.0, 0.0), marks=pytest.mark.long),
        pytest.param(0.0, (0.03, 0.0), marks=pytest.mark.long),
    ],
)
def test_what_the_holes_hold_turns_the_nail_by_no_more_than_is_predicted(
    per_mm: float, rise: tuple[float, float]
) -> None:
    fit = fitted(per_mm, rise)
    assert axis_error_deg(fit) < 2.0 * axis_sd_deg(fit)
    assert axis_error_deg(fit) < 0.6  # 0.42° at most; with a background as smooth there as elsewhere 2.9°


@pytest.mark.parametrize(
    ("per_mm", "expected"), [(0.0, 10.0), (0.06, 40.0), pytest.param(-0.05, 40.0, marks=pytest.mark.long)]
)
def test_the_background_is_as_loose_about_the_holes_as_the_image_shows(per_mm: float, expected: float) -> None:
    problem = fitted(per_mm, (0.0, 0.0)).end.problem
    of_field = problem.field.roughness
    (found,) = (f for f in HOLE_CONTENT.looser if np.array_equal(loosened(problem, f).field.roughness, of_field))
    assert found == expected


@pytest.mark.requirement("REG-06")
@pytest.mark.parametrize(("channel_share", "least_deg", "most_deg"), [(0.0, 0.0, 0.1), (0.8, 0.15, 1.0)])
def test_a_channel_in_what_fills_the_holes_makes_their_axes_uncertain(
    channel_share: float, least_deg: float, most_deg: float
) -> None:
    found = fitted(0.025, (0.0, 0.0), channel_share)
    assert least_deg <= found.fit.evidence.channel_deg <= most_deg  # measured: 0.03 and 0.29
    assert axis_error_deg(found) < 2.0 * axis_sd_deg(found)


def test_the_background_is_loose_next_to_the_holes_alone() -> None:
    hole = NAIL.holes[0]
    x_mm, radius_mm = hole.axis.point_mm[0], 0.5 * hole.diameter_mm
    stiff = stiffness_about_holes(NAIL, 10.0)(np.array([[x_mm], [x_mm + 2.6 * radius_mm]]), np.array([0.0, radius_mm]))
    np.testing.assert_allclose(stiff, [[0.01, 0.01], [1.0, 1.0]])
