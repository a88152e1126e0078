"""Which of several fits of one image is taken."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from services.registration.core.nail import fit
from services.registration.core.nail.image_fit import ImageFit, fit_image
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.region import FitInput
from shared.errors import Rejected
from shared.geometry.frames import Nail
from shared.geometry.transform import Transform
from tests.unit.services.registration.rendered_case import CAMERA_FROM_NAIL, SIZE_PX, rendered_parts, turned_nail
from tests.unit.services.registration.xray_scene import Scene, calibration, render

PARTS, VIEW = rendered_parts(), calibration(SIZE_PX)


@pytest.fixture(scope="module")
def fit_input() -> FitInput:
    pixels = render(Scene(SIZE_PX, PARTS.nail, CAMERA_FROM_NAIL), VIEW, 5)
    return FitInput(pixels, VIEW, PARTS.nail, Occluders(None, PARTS.ring))


@pytest.fixture(scope="module")
def image_fit(fit_input: FitInput) -> ImageFit:
    found = fit_image(fit_input, turned_nail((3.0, -1.5)))
    assert not isinstance(found, Rejected)
    return found


def turned(found: ImageFit, *turn_deg: float) -> ImageFit:
    turn = Transform[Nail, Nail].from_rotvec(np.radians(turn_deg), np.zeros(3))
    return replace(found, fit=replace(found.fit, camera_from_nail=found.fit.camera_from_nail @ turn))


@pytest.mark.requirement("REG-05")
@pytest.mark.parametrize(
    ("turn_deg", "taken"), [((1.4, 0.0, 0.0), True), ((0.0, 1.6, 0.0), False), ((0.0, 0.0, 20.0), True)]
)
def test_a_fit_beside_objects_keeps_the_hole_axes_of_the_holes_surroundings(
    monkeypatch: pytest.MonkeyPatch,
    fit_input: FitInput,
    image_fit: ImageFit,
    turn_deg: tuple[float, float, float],
    *,
    taken: bool,
) -> None:
    first, again = image_fit, turned(image_fit, *turn_deg)
    monkeypatch.setattr(
        fit, "_fitted_without_foreign_objects", Mock(side_effect=[(fit_input, first), (fit_input, again)])
    )
    monkeypatch.setattr(fit, "_seen_from_the_holes", Mock(return_value=(fit_input, image_fit.fit.camera_from_nail)))
    found = fit._without_objects(fit_input, image_fit.fit.camera_from_nail, first)
    assert not isinstance(found, Rejected)
    assert found.fit.evidence.objects_left_out is taken
    assert (found is first) is not taken


@pytest.mark.parametrize(("ratio", "darkness", "shows"), [(4.0, 0.4, True), (4.0, 0.3, False), (1.2, 0.9, False)])
def test_an_object_is_evident_where_parts_disagree_and_something_is_dark(
    monkeypatch: pytest.MonkeyPatch, image_fit: ImageFit, ratio: float, darkness: float, *, shows: bool
) -> None:
    monkeypatch.setattr(fit, "fit_reasons", Mock(return_value=()))
    evidence = image_fit.fit.evidence
    evidence = replace(evidence, error_ratio=ratio, residual=replace(evidence.residual, darkness=darkness))
    assert fit._shows_an_object(replace(image_fit, fit=replace(image_fit.fit, evidence=evidence))) is shows
