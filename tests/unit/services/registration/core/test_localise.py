"""From a rendered image to both axes and a verdict; all reasons at once when something is missing."""

import time

import cv2
import numpy as np
import pytest

from services.registration.core.localise import LocalisationResult, LocalisationStep, localise
from services.registration.overlay import GUIDE, NAIL, overlay_png
from services.registration.report import timed_localisation
from shared.errors import Accepted, ReasonCode
from shared.geometry.lines import angle_between_rad
from tests.unit.services.registration.core.test_fusion import NOTHING
from tests.unit.services.registration.rendered_case import (
    SIZE_PX,
    Shown,
    rendered,
    rendered_parts,
    true_guide_from_nail,
    turned_nail,
)


def run(shown: Shown, seed: int) -> LocalisationResult:
    pixels, view = rendered(shown, seed)
    steps: list[LocalisationStep] = []
    result = localise(pixels, view, rendered_parts(), steps.append)
    assert steps == [LocalisationStep.GUIDE, LocalisationStep.NAIL]
    return result


def codes(result: LocalisationResult) -> set[ReasonCode]:
    return {reason.code for reason in result.reasons}


@pytest.mark.requirement("REG-01")
@pytest.mark.parametrize("shown", [Shown(), Shown(mirrored=True)], ids=["as it is", "mirrored"])
def test_both_axes_are_found_where_they_are(shown: Shown) -> None:
    result = run(shown, seed=1)
    assert result.reasons == ()
    assert result.holes is not None
    truth = true_guide_from_nail(shown)
    for hole, x_mm in zip(result.holes, (15.0, -15.0), strict=True):
        true_axis = truth.rotation[:, 2]
        apart = hole.entry_guide_mm - truth @ np.array([x_mm, 0.0, -6.0])
        across_mm = float(np.linalg.norm(apart - true_axis * (apart @ true_axis)))
        axis_deg = float(np.degrees(angle_between_rad(hole.axis_guide.direction, true_axis)))
        print(f"{hole.id}: {across_mm:.3f} mm {axis_deg:.3f} deg")
        assert across_mm < 0.2
        assert axis_deg < 0.5
        assert hole.offset is not None
        assert hole.chance_along_estimate is not None
        assert hole.chance_along_estimate >= 0.99


def test_without_a_nail_the_guide_is_still_told() -> None:
    result = run(Shown(nail=None), seed=2)
    assert codes(result) <= {ReasonCode.NAIL_NOT_FOUND, ReasonCode.HOLE_NOT_VISIBLE}
    assert result.reasons
    assert result.guide is not None
    assert result.nail is None
    assert result.holes is None


def test_without_guide_the_nail_is_still_told() -> None:
    result = run(Shown(guide=None), seed=3)
    assert ReasonCode.GUIDE_NOT_FOUND in codes(result)
    assert result.holes is None
    assert result.guide_from_nail is None


def test_without_either_both_reasons_are_told() -> None:
    result = run(Shown(guide=None, nail=None), seed=4)
    assert codes(result) == {ReasonCode.GUIDE_NOT_FOUND, ReasonCode.NAIL_NOT_FOUND}


def test_a_steep_nail_is_not_accepted() -> None:
    result = run(Shown(nail=turned_nail((17.0, 0.0))), seed=5)
    assert codes(result) == {ReasonCode.TILT_TOO_LARGE}


def test_times_add_up_and_the_drawing_shows_what_was_found() -> None:
    pixels, view = rendered(Shown(), seed=7)
    parts = rendered_parts()
    started = time.perf_counter()
    result, message = timed_localisation(pixels, Accepted(view), parts, "a" * 64, ring_ms=100.0)
    elapsed_ms = 1e3 * (time.perf_counter() - started)
    times = message.timing_ms
    assert times.guide is not None
    assert times.nail is not None
    assert times.guide + times.nail <= times.total - 100.0 <= elapsed_ms
    drawn = cv2.imdecode(np.frombuffer(overlay_png(pixels, view, result, parts), np.uint8), cv2.IMREAD_COLOR)
    assert drawn is not None
    assert drawn.shape == (SIZE_PX, SIZE_PX, 3)
    for colour in (GUIDE, NAIL):
        # lines are drawn with soft edges: few pixels have exactly the colour
        near = np.abs(drawn.astype(np.int64) - np.array(colour)).max(axis=2) < 60
        assert np.count_nonzero(near) > 50


def test_an_image_without_a_ring_is_drawn_bare() -> None:
    pixels, _ = rendered(Shown(), seed=8)
    drawn = cv2.imdecode(
        np.frombuffer(overlay_png(pixels, None, NOTHING.result, rendered_parts()), np.uint8), cv2.IMREAD_COLOR
    )
    assert drawn is not None
    assert (drawn[..., 0] == drawn[..., 1]).all()
