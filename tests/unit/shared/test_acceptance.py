"""Criteria: which values they accept, and how sentences quote them."""

import pytest

from shared.acceptance import Criterion, Finding, Refusal, at_least, at_most
from shared.errors import Reason, ReasonCode

TILT = Criterion(
    code=ReasonCode.TILT_TOO_LARGE,
    measured="tilt",
    limit=at_most(14.0, "°", decimals=1),
    remedy="turn the C-arm",
    origin="test",
)
SHARE = Criterion(
    code=ReasonCode.HOLE_NOT_VISIBLE,
    measured="share",
    limit=at_least(0.35, "%", decimals=0),
    remedy="move what covers it",
    origin="test",
)


@pytest.mark.parametrize(("criterion", "acceptable", "unacceptable"), [(TILT, 14.0, 14.001), (SHARE, 0.35, 0.349)])
def test_the_limit_itself_is_acceptable(
    criterion: Criterion[ReasonCode], acceptable: float, unacceptable: float
) -> None:
    assert criterion.is_met(acceptable)
    assert not criterion.is_met(unacceptable)


@pytest.mark.parametrize("criterion", [TILT, SHARE])
def test_what_is_no_number_is_never_acceptable(criterion: Criterion[ReasonCode]) -> None:
    assert not criterion.is_met(float("nan"))


def test_a_limit_that_depends_on_the_case_replaces_the_usual_one() -> None:
    assert TILT.is_met(15.0, 16.0)
    assert TILT.quoted(16.04, 16.0) == "16.04° (limit 16.00°)"


def test_values_are_quoted_with_limit_and_unit_and_never_read_as_the_limit() -> None:
    assert TILT.quoted(14.2) == "14.2° (limit 14°)"
    assert TILT.quoted(14.01) == "14.01° (limit 14°)"
    assert TILT.quoted(15.0, sign="+") == "+15.0° (limit 14°)"
    assert SHARE.quoted(0.1) == "10 % (at least 35 %)"


def test_a_reason_says_what_was_measured_and_what_to_do() -> None:
    assert TILT.reason("tilted by 15°") == Reason(ReasonCode.TILT_TOO_LARGE, "tilted by 15°; turn the C-arm")
    assert TILT.reason("tilted", "turn by 3°").message == "tilted; turn by 3°"


def test_a_finding_has_a_sentence_of_its_own() -> None:
    finding = Finding(code=ReasonCode.NAIL_NOT_FOUND, observed="no band was found", remedy="centre the nail")
    assert finding.reason() == Reason(ReasonCode.NAIL_NOT_FOUND, "no band was found; centre the nail")
    assert finding.reason("band 3 is too wide").message == "band 3 is too wide; centre the nail"


def test_the_refusal_of_a_plan_has_the_code_and_the_remedy() -> None:
    order = Finding(ReasonCode.NAIL_MODEL_MISMATCH, "the holes are exchanged", "check the ids")
    assert TILT.refusal("the axis is tilted by 15° (limit 14°)") == Refusal(
        ReasonCode.TILT_TOO_LARGE, "the axis is tilted by 15° (limit 14°); turn the C-arm"
    )
    assert order.refusal() == Refusal(ReasonCode.NAIL_MODEL_MISMATCH, "the holes are exchanged; check the ids")
    assert order.refusal("hole 'a' comes first").message == "hole 'a' comes first; check the ids"
