"""The table of refusals: every code once, with what is checked and what to do."""

import pytest

from services.robot.core.refusals import CRITERIA, Refusal, RefusalCode, RefusalCriterion, refusal


def test_every_code_has_a_criterion() -> None:
    assert list(CRITERIA) == [criterion.code for criterion in CRITERIA.values()]
    assert set(CRITERIA) == set(RefusalCode)


@pytest.mark.parametrize("criterion", CRITERIA.values(), ids=lambda criterion: criterion.code.value)
def test_a_criterion_is_complete(criterion: RefusalCriterion) -> None:
    assert criterion.checked
    assert criterion.limit
    assert criterion.remedy or criterion.code is RefusalCode.NOTHING_TO_DO
    assert not criterion.remedy.endswith(".")


def test_a_refusal_ends_with_the_remedy() -> None:
    code = RefusalCode.HEAD_EXTENSION
    assert refusal(code, "the extension is 90 mm") == Refusal(
        code, "the extension is 90 mm; read its scale again and correct the case"
    )
    assert refusal(code, "it is 90 mm", "set it anew").message == "it is 90 mm; set it anew"
    assert refusal(RefusalCode.NOTHING_TO_DO, "it is locked").message == "it is locked"
