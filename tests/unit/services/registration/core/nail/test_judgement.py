"""Reasons against a fitted nail: each limit by itself, and the sentences."""

from dataclasses import replace

import numpy as np
import pytest

from services.registration.core.nail.judgement import (
    Evidence,
    HoleView,
    ResidualStatistics,
    nail_outside,
    reasons_against,
)
from shared.errors import ReasonCode
from tests.accuracy.registration.nail.fluoroscope import nail_part

NAIL = nail_part("steel", 12.0, 6.0)
GOOD = Evidence(
    NAIL,
    (HoleView("distal", 0.9, 12.0), HoleView("proximal", 0.8, 9.0)),
    ResidualStatistics(800.0, 1.1, 5.0, 0.1),
    0.01,
    -0.02,
    120.0,
)


def test_a_good_fit_has_nothing_against_it() -> None:
    assert reasons_against(GOOD) == ()


@pytest.mark.parametrize(
    ("evidence", "code", "words"),
    [
        (
            replace(GOOD, holes=(HoleView("distal", 0.1, 12.0), GOOD.holes[1])),
            ReasonCode.HOLE_NOT_VISIBLE,
            "hole 'distal' shows 10 % of its disc (limit 12 %)",
        ),
        (
            replace(GOOD, holes=(HoleView("distal", 0.3, 12.0), HoleView("proximal", 0.2, 9.0))),
            ReasonCode.HOLE_NOT_VISIBLE,
            "hole 'distal' shows 30 % of its disc (limit 35 %)",
        ),
        (
            replace(GOOD, holes=(HoleView("distal", 0.9, 1.2), GOOD.holes[1])),
            ReasonCode.HOLE_NOT_VISIBLE,
            "1.2 standard deviations of the noise brighter",
        ),
        (replace(GOOD, hole_radius_excess_mm=0.2), ReasonCode.NAIL_MODEL_MISMATCH, "the holes measure +0.40 mm"),
        (replace(GOOD, nail_radius_excess_mm=-0.15), ReasonCode.NAIL_MODEL_MISMATCH, "the nail measures -0.30 mm"),
        (
            replace(GOOD, residual=ResidualStatistics(800.0, 3.1, 5.0, 0.1)),
            ReasonCode.NAIL_MODEL_MISMATCH,
            "along the nail's edges is 3.1 times",
        ),
        (
            replace(GOOD, residual=ResidualStatistics(800.0, 1.1, 14.0, 0.1)),
            ReasonCode.NAIL_MODEL_MISMATCH,
            "over 14.0 pixels (limit 10)",
        ),
        (
            replace(GOOD, residual=ResidualStatistics(800.0, 1.1, 5.0, 0.7)),
            ReasonCode.NAIL_MODEL_MISMATCH,
            "by 70 % of the step from metal to background (limit 30 %)",
        ),
        (replace(GOOD, mirror_margin=3.0), ReasonCode.MIRROR_AMBIGUOUS, "likelihood ratio 3.0 (limit 8)"),
    ],
)
def test_each_limit_has_its_reason(evidence: Evidence, code: ReasonCode, words: str) -> None:
    reasons = reasons_against(evidence)
    assert [reason.code for reason in reasons] == [code]
    assert words in reasons[0].message


def test_one_hole_in_full_and_a_part_of_the_other_are_enough() -> None:
    assert reasons_against(replace(GOOD, holes=(HoleView("distal", 0.15, 12.0), GOOD.holes[1]))) == ()


@pytest.mark.parametrize(
    "evidence",
    [
        replace(GOOD, holes=(HoleView("distal", np.nan, 12.0), GOOD.holes[1])),
        replace(GOOD, holes=(HoleView("distal", 0.9, np.nan), GOOD.holes[1])),
        replace(GOOD, hole_radius_excess_mm=np.nan),
        replace(GOOD, nail_radius_excess_mm=np.nan),
        replace(GOOD, residual=ResidualStatistics(800.0, np.nan, 5.0, 0.1)),
        replace(GOOD, residual=ResidualStatistics(800.0, 1.1, np.nan, 0.1)),
        replace(GOOD, residual=ResidualStatistics(800.0, 1.1, 5.0, np.nan)),
        replace(GOOD, mirror_margin=np.nan),
    ],
)
def test_what_is_no_number_is_refused(evidence: Evidence) -> None:
    assert len(reasons_against(evidence)) >= 1


def test_a_nail_outside_the_image_names_its_holes() -> None:
    (reason,) = nail_outside(NAIL).reasons
    assert reason.code == ReasonCode.HOLE_NOT_VISIBLE
    assert "'distal', 'proximal'" in reason.message
