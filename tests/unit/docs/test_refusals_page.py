"""`docs/refusals.md` is printed from the services' criteria, and every code of a rejected image stands in it."""

from pathlib import Path

from shared.acceptance import Criterion, Finding
from shared.errors import ReasonCode
from tools.refusals_page import acceptance_modules, declared_criteria, refusals_page

_PAGE = Path(__file__).parents[3] / "docs" / "refusals.md"


def test_the_page_is_up_to_date() -> None:
    assert _PAGE.read_text(encoding="utf-8") == refusals_page(), "run: make generated"


def test_a_criterion_is_declared_for_each_code() -> None:
    assert set(ReasonCode) <= {criterion.code for _, criterion in declared_criteria()}


def test_every_criterion_is_listed() -> None:
    # Only annotated names are: criteria that a module imports would otherwise be listed there too.
    listed = {id(criterion) for _, criterion in declared_criteria()}
    for module in acceptance_modules():
        named = {name: value for name, value in vars(module).items() if isinstance(value, Criterion | Finding)}
        assert not [name for name, value in named.items() if id(value) not in listed], "declare it as NAME: Final = ..."


def test_no_criterion_is_listed_twice() -> None:
    criteria = [criterion for _, criterion in declared_criteria()]
    assert len({id(criterion) for criterion in criteria}) == len(criteria) > 30
