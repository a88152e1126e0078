"""A hole beside its place is known from the rims of the holes and the nail's edges."""

from dataclasses import replace

import numpy as np
import pytest

from services.registration.core.nail.fit import measure_nail
from services.registration.core.nail.image_fit import NailFit
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.region import FitInput
from shared.errors import Accepted
from shared.geometry.lines import Line
from shared.geometry.parts import NailPart
from tests.unit.services.registration.rendered_case import CAMERA_FROM_NAIL, SIZE_PX, rendered_parts, turned_nail
from tests.unit.services.registration.xray_scene import Scene, calibration, render

PARTS = rendered_parts()


def with_first_hole_aside(nail: NailPart, aside_mm: float) -> NailPart:
    first, *others = nail.holes
    axis = Line(first.axis.point_mm + np.array([0.0, aside_mm, 0.0]), first.axis.direction)
    return replace(nail, holes=(replace(first, axis=axis), *others))


def fit_with_hole_aside(aside_mm: float) -> NailFit:
    """The fit of a nail with one hole beside its place, by the file that has it in its place."""
    view = calibration(SIZE_PX)
    pixels = render(Scene(SIZE_PX, with_first_hole_aside(PARTS.nail, aside_mm), CAMERA_FROM_NAIL), view, 5)
    found = measure_nail(FitInput(pixels, view, PARTS.nail, Occluders(None, PARTS.ring)), turned_nail((3.0, -1.5)))
    assert isinstance(found, Accepted)
    return found.value


@pytest.mark.requirement("REG-06")
@pytest.mark.parametrize(("aside_mm", "least_mm", "most_mm"), [(0.0, 0.0, 0.015), (0.12, 0.06, 0.11)])
def test_the_spread_of_the_holes_is_that_of_their_places(aside_mm: float, least_mm: float, most_mm: float) -> None:
    # of one hole 0.12 mm aside among two the rms is 0.085 mm
    assert least_mm <= fit_with_hole_aside(aside_mm).hole_spread_mm <= most_mm


def test_a_hole_of_which_no_pixel_is_left_has_no_turn_of_its_own() -> None:
    view = calibration(SIZE_PX)
    pixels = render(Scene(SIZE_PX, PARTS.nail, CAMERA_FROM_NAIL), view, 5)
    middle = view.image_from_camera(CAMERA_FROM_NAIL @ np.array([-15.0, 0.0, 0.0]))
    rows, columns = np.ogrid[:SIZE_PX, :SIZE_PX]
    hidden = np.hypot(columns - middle[0], rows - middle[1]) < 45.0
    given = FitInput(pixels, view, PARTS.nail, Occluders(None, PARTS.ring, hidden=hidden))
    found = measure_nail(given, turned_nail((3.0, -1.5)))
    assert isinstance(found, Accepted)
    assert np.all(np.isfinite(found.value.errors.covariance))
