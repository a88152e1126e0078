"""A bent nail of another tilt than the straight one's carries by how much it explains the image better."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from services.registration.core.acceptance.image import fit_reasons
from services.registration.core.nail import image_fit
from services.registration.core.nail.bent_nail import BentOptimum, bent_optimum
from services.registration.core.nail.image_fit import fit_image
from services.registration.core.nail.least_squares import Problem, Solution
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.region import FitInput
from services.registration.core.tuning import BENT_NAIL
from shared.errors import Rejected
from tests.unit.services.registration.rendered_case import CAMERA_FROM_NAIL, SIZE_PX, rendered_parts, turned_nail
from tests.unit.services.registration.xray_scene import Scene, calibration, render


@pytest.mark.requirement("REG-05")
@pytest.mark.parametrize(("of_straight", "carried"), [(-20.0, True), (20.0, False), (None, False)])
def test_a_bent_nail_carries_its_margin_over_a_straight_one_of_another_tilt(
    monkeypatch: pytest.MonkeyPatch, of_straight: float | None, *, carried: bool
) -> None:
    def found(problem: Problem, straight: Solution) -> BentOptimum:
        optimum = bent_optimum(problem, straight)
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
