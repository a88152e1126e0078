"""`docs/refusals.md` is printed from the services' criteria, and every code of a rejected image stands in it."""

from pathlib import Path

from shared.errors import ReasonCode
from tools.refusals_page import declared_criteria, refusals_page

_PAGE = Path(__file__).parents[3] / "docs" / "refusals.md"


def test_the_page_is_up_to_date() -> None:
    assert _PAGE.read_text(encoding="utf-8") == refusals_page(), "run: make generated"


def test_registration_declares_a_criterion_for_each_of_its_codes() -> None:
    declared = {criterion.code for where, criterion in declared_criteria() if where.startswith("registration/")}
    of_imaging = {
        ReasonCode.IMAGE_UNUSABLE,
        ReasonCode.SATURATED,
        ReasonCode.RING_NOT_FOUND,
        ReasonCode.RING_AMBIGUOUS,
        ReasonCode.RING_TOO_FEW_BALLS,
    }
    assert set(ReasonCode) - of_imaging <= declared


def test_no_criterion_is_listed_twice() -> None:
    criteria = [criterion for _, criterion in declared_criteria()]
    assert len({id(criterion) for criterion in criteria}) == len(criteria) > 30
