"""The part of `make model-check` that `make test` has time for: one scope whole, and its mutations."""

from pathlib import Path

import pytest

from tests.model.check import searched, searched_with
from tests.model.mutation import Mutation
from tests.model.mutations import MUTATIONS
from tests.model.properties import STATEMENTS, Property
from tests.model.report import properties_table
from tests.model.scope import SCOPES
from tests.model.search import Model, Step, search

# CI plays all of them with `make model-check`.
_OF_FIRST_SCOPE = tuple(mutation for mutation in MUTATIONS if mutation.scope == SCOPES[0].name)


@pytest.mark.requirement("ROB-01")
def test_every_property_holds_in_every_order_of_late_lost_and_repeated_commands() -> None:
    found = searched(SCOPES[0])
    assert found.violation is None, str(found.violation)
    assert found.complete
    assert found.states > 1000, "the search has hardly begun"


@pytest.mark.parametrize("mutation", _OF_FIRST_SCOPE, ids=lambda mutation: mutation.says)
def test_a_seeded_mutation_breaks_a_property(mutation: Mutation) -> None:
    found = searched_with(mutation)
    assert found.violation is not None, f"{mutation.says}: nothing noticed in {found.states} states"
    assert found.violation.trace, "the shortest way there, from the start"


def test_there_are_at_least_twenty_mutations_and_each_property_has_words_and_a_formula() -> None:
    assert len({mutation.says for mutation in MUTATIONS}) == len(MUTATIONS) >= 20
    assert set(STATEMENTS) == set(Property)


def test_the_page_of_safety_states_the_properties_that_are_checked() -> None:
    page = (Path(__file__).parents[2] / "docs" / "safety.md").read_text(encoding="utf-8")
    printed = page.split("<!-- properties: begin -->\n")[1].split("\n<!-- properties: end -->")[0]
    assert printed == properties_table()


def _ways(state: int) -> list[Step[int]]:
    """From 0 to 3 the long way or the short one; 4 is a dead end."""
    ways = {0: (1, 3), 1: (2,), 2: (3, 4), 3: (0,), 4: ()}
    return [Step(f"to {after}", after, helps=True) for after in ways[state]]


def _model(bad: int, goal: int) -> Model[int]:
    return Model((0,), _ways, lambda s: ("bad",) if s == bad else (), lambda s: s == goal, str, "goal")


def test_the_trace_of_a_violation_is_the_shortest() -> None:
    violation = search(_model(bad=3, goal=0)).violation
    assert violation is not None
    assert violation.trace == (("at the start", "0"), ("to 3", "3"))


def test_a_state_without_a_way_to_the_goal_is_found() -> None:
    found = search(_model(bad=9, goal=0))
    assert found.complete
    assert found.violation is not None
    assert (found.violation.property_name, found.violation.trace[-1]) == ("goal", ("to 4", "4"))
    assert (found.states, found.transitions, found.depth) == (5, 6, 3)
