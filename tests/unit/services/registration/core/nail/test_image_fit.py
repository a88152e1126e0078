"""Bent nails beside straight ones, and a nail of another metal than its file's.

A bent nail of another tilt than the straight one's carries by how much it explains the image better; one that is bent
otherwise, beside it, makes it uncertain, or leaves the nail straight.
"""

from dataclasses import replace
from typing import Literal
from unittest.mock import Mock

import numpy as np
import pytest

from services.registration.core.acceptance.image import fit_reasons
from services.registration.core.nail import image_fit
from services.registration.core.nail.bent_nail import BentOptimum, bent_optimum
from services.registration.core.nail.image_fit import fit_image
from services.registration.core.nail.least_squares import LinearSolution, Problem, linear_solution_at
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.parameters import CURVATURE, Parameter
from services.registration.core.nail.region import FitInput
from services.registration.core.tuning import BENT_NAIL, NAIL_PRIORS
from shared.errors import Rejected
from tests.unit.services.registration.rendered_case import CAMERA_FROM_NAIL, SIZE_PX, rendered_parts, turned_nail
from tests.unit.services.registration.xray_scene import Scene, calibration, nail_part, render

Metal = Literal["steel", "Ti6Al4V"]


@pytest.mark.requirement("REG-05")
@pytest.mark.parametrize(
    ("of_straight", "carried"), [(-20.0, True), pytest.param(20.0, False, marks=pytest.mark.long), (None, False)]
)
def test_a_bent_nail_carries_its_margin_over_a_straight_one_of_another_tilt(
    monkeypatch: pytest.MonkeyPatch, of_straight: float | None, *, carried: bool
) -> None:
    def found(problem: Problem, begun: LinearSolution) -> BentOptimum:
        optimum = bent_optimum(problem, begun)
        assert optimum is not None
        return replace(optimum, margin=20.0, straight_margin=of_straight)

    parts, view = rendered_parts(), calibration(SIZE_PX)
    pixels = render(Scene(SIZE_PX, parts.nail, CAMERA_FROM_NAIL), view, 5)
    monkeypatch.setattr(image_fit, "is_bent", Mock(return_value=True))
    monkeypatch.setattr(image_fit, "BENT_NAIL", replace(BENT_NAIL, largest_error_ratio=np.inf))
    monkeypatch.setattr(image_fit, "bent_optimum", found)
    bent = fit_image(FitInput(pixels, view, parts.nail, Occluders(None, parts.ring)), turned_nail((3.0, -1.5)))
    assert not isinstance(bent, Rejected)
    assert np.linalg.norm(bent.fit.curvature_per_m) > 0.0
    evidence = bent.fit.evidence  # both margins are 20, and what parts of the image disagree by is divided out of both
    assert evidence.straight_margin == (evidence.mirror_margin if carried else np.inf)
    named = any("nearly as well as a bent one" in reason.message for reason in fit_reasons(evidence))
    assert named is carried


@pytest.mark.requirement("REG-05")
@pytest.mark.parametrize(
    ("curvature_per_m", "held_straight"), [(1.0, False), pytest.param(0.0, True, marks=pytest.mark.long)]
)
def test_a_nail_that_is_bent_otherwise_nearly_as_well_makes_the_axes_uncertain(
    monkeypatch: pytest.MonkeyPatch, curvature_per_m: float, *, held_straight: bool
) -> None:
    def beside(problem: Problem, begun: LinearSolution) -> BentOptimum:
        optimum = bent_optimum(problem, begun)
        assert optimum is not None
        parameters = optimum.solution.parameters.copy()
        parameters[CURVATURE], parameters[Parameter.PITCH_RAD] = curvature_per_m, parameters[Parameter.PITCH_RAD] + 0.01
        near = replace(optimum.solution, linear=linear_solution_at(problem, parameters))
        return replace(optimum, margin=20.0, straight_margin=None, near=near)

    def bent_beyond(curvature: np.ndarray, _: np.ndarray) -> bool:
        return bool(np.all(curvature != 0.0))

    parts, view = rendered_parts(), calibration(SIZE_PX)
    image = FitInput(
        render(Scene(SIZE_PX, parts.nail, CAMERA_FROM_NAIL), view, 5), view, parts.nail, Occluders(None, parts.ring)
    )
    monkeypatch.setattr(image_fit, "is_bent", bent_beyond)
    monkeypatch.setattr(image_fit, "BENT_NAIL", replace(BENT_NAIL, largest_error_ratio=np.inf))
    alone = fit_image(image, turned_nail((3.0, -1.5)))
    monkeypatch.setattr(image_fit, "bent_optimum", beside)
    found = fit_image(image, turned_nail((3.0, -1.5)))
    assert not isinstance(alone, Rejected)
    assert not isinstance(found, Rejected)
    assert found.fit.other_bend_deg > 0.5 > alone.fit.other_bend_deg
    assert (found.fit.curvature_per_m == (0.0, 0.0)) is held_straight
    if held_straight:  # by as much as the bend that was found
        assert found.fit.errors.bend_sd_per_m > NAIL_PRIORS.straightness_sd_per_m
    else:
        sd_deg = [np.degrees(np.sqrt(one.fit.errors.covariance_with_bend[1, 1])) for one in (alone, found)]
        assert sd_deg[1] > 1.5 * sd_deg[0]


@pytest.mark.requirement("REG-05")
@pytest.mark.parametrize(
    ("material", "filed", "words"),
    [
        ("Ti6Al4V", "steel", "the material in its file attenuates"),
        ("Ti6Al4V", "Ti6Al4V", None),
        pytest.param("steel", "steel", None, marks=pytest.mark.long),
    ],
)
def test_a_nail_of_another_metal_than_its_files_is_named(material: Metal, filed: Metal, words: str | None) -> None:
    view = calibration(SIZE_PX)
    pixels = render(Scene(SIZE_PX, nail_part(material=material), CAMERA_FROM_NAIL), view, 5)
    given = FitInput(pixels, view, nail_part(material=filed), Occluders(None, rendered_parts().ring))
    found = fit_image(given, turned_nail((3.0, -1.5)))
    assert not isinstance(found, Rejected)
    named = [reason.message for reason in fit_reasons(found.fit.evidence) if "attenuates" in reason.message]
    assert len(named) == (0 if words is None else 1)
    assert all(str(words) in message for message in named)
