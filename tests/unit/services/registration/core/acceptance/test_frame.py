"""Acceptance of a frame of fluoroscopy: each limit refuses with its own reason."""

from dataclasses import replace

import pytest

from services.registration.core.acceptance.frame import FrameEvidence, frame_reasons, margin_reasons
from services.registration.core.acceptance.image import HoleView
from shared.errors import ReasonCode

GOOD = FrameEvidence(
    holes=(HoleView("distal", 0.9, 12.0), HoleView("proximal", 0.8, 9.0)),
    structure=1.2,
    unexplained=0.01,
    turned_deg=(0.4, -0.9),
    turn_sd_deg=(0.1, 0.3),
    across_mm=0.3,
    blur_px=1.5,
    reference_blur_px=1.2,
    tilt_sd_deg=0.4,
)
NAN = float("nan")


def test_within_all_limits_is_accepted() -> None:
    assert frame_reasons(GOOD) == ()


@pytest.mark.parametrize(
    "evidence",
    [
        replace(GOOD, holes=(HoleView("distal", 0.35, 3.0), HoleView("proximal", 0.12, 3.0))),
        replace(GOOD, structure=2.5, unexplained=0.02),
        replace(GOOD, turned_deg=(0.5, -1.0), turn_sd_deg=(0.1, 0.25), across_mm=1.0),
        replace(GOOD, blur_px=2.0),
        replace(GOOD, tilt_sd_deg=1.5),
    ],
)
def test_values_exactly_at_their_limits_are_accepted(evidence: FrameEvidence) -> None:
    assert frame_reasons(evidence) == ()


def test_each_rotation_needs_its_predicted_deviation() -> None:
    with pytest.raises(ValueError, match="shorter"):
        frame_reasons(replace(GOOD, turn_sd_deg=(0.1,)))


@pytest.mark.parametrize(
    ("evidence", "code", "words"),
    [
        (
            replace(GOOD, holes=(HoleView("distal", 0.1, 12.0), GOOD.holes[1])),
            ReasonCode.HOLE_NOT_VISIBLE,
            "hole 'distal' shows 10 % (at least 12 %) of its disc; move what covers it",
        ),
        (
            replace(GOOD, holes=(HoleView("distal", 0.9, 2.0), GOOD.holes[1])),
            ReasonCode.HOLE_NOT_VISIBLE,
            "take away what covers it, or raise the dose",
        ),
        (replace(GOOD, structure=2.6), ReasonCode.NAIL_MODEL_MISMATCH, "2.6 times (limit 2.5 times) that elsewhere"),
        (replace(GOOD, unexplained=0.03), ReasonCode.NAIL_MODEL_MISMATCH, "3.0 % (limit 2 %) of the pixels"),
        (
            replace(GOOD, turned_deg=(0.4, -1.3)),
            ReasonCode.NAIL_MODEL_MISMATCH,
            "turned by 0.4° (limit 0.5°) and 1.3° (limit 1.2°) about its axes",
        ),
        (replace(GOOD, across_mm=1.1), ReasonCode.NAIL_MODEL_MISMATCH, "1.1 mm (limit 1 mm) from where the guide"),
        (replace(GOOD, blur_px=2.1), ReasonCode.MOTION_BLUR, "blurred by 2.1 px (limit 2.0 px) in this frame"),
        (replace(GOOD, tilt_sd_deg=1.6), ReasonCode.UNCERTAINTY_TOO_LARGE, "1.6° (limit 1.5°)"),
    ],
)
def test_each_limit_has_its_reason(evidence: FrameEvidence, code: ReasonCode, words: str) -> None:
    reasons = frame_reasons(evidence)
    assert [reason.code for reason in reasons] == [code]
    assert words in reasons[0].message


def test_a_rotation_within_four_predicted_deviations_is_accepted() -> None:
    assert frame_reasons(replace(GOOD, turned_deg=(0.4, -1.3), turn_sd_deg=(0.1, 0.4))) == ()


@pytest.mark.parametrize(
    "evidence",
    [
        replace(GOOD, structure=NAN),
        replace(GOOD, unexplained=NAN),
        replace(GOOD, across_mm=NAN),
        replace(GOOD, blur_px=NAN),
        replace(GOOD, tilt_sd_deg=NAN),
    ],
)
def test_what_is_no_number_is_refused(evidence: FrameEvidence) -> None:
    assert len(frame_reasons(evidence)) == 1


@pytest.mark.requirement("REG-02")
def test_a_reflection_that_explains_as_much_is_refused() -> None:
    assert margin_reasons(None) == margin_reasons(8.0) == ()
    (reason,) = margin_reasons(7.9)
    assert reason.code is ReasonCode.MIRROR_AMBIGUOUS
    assert "7.9 (at least 8)" in reason.message
