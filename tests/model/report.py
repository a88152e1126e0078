"""What a check has found, as tables: states visited, and what each mutation breaks."""

from collections.abc import Sequence

from tests.model.mutation import Mutation
from tests.model.properties import STATEMENTS
from tests.model.scope import Scope
from tests.model.search import Searched
from tests.model.world import World


def properties_table() -> str:
    """What must hold, in words and as a formula, as it stands in `docs/safety.md`."""
    rows = [f"| {name.value} | {says.words} | `{says.formula}` |" for name, says in STATEMENTS.items()]
    return "\n".join(["| property | in words | formula |", "|---|---|---|", *rows])


def scopes_table(scopes: Sequence[Scope], found: Sequence[Searched[World]]) -> str:
    """A row for each scope."""
    rows = [
        f"| {scope.name} | {one.states:,} | {one.transitions:,} | {one.depth} | {one.seconds:.1f} s | {_verdict(one)} |"
        for scope, one in zip(scopes, found, strict=True)
    ]
    states, transitions = sum(one.states for one in found), sum(one.transitions for one in found)
    total = f"| all | {states:,} | {transitions:,} | {max(one.depth for one in found)} | | |"
    head = ["| scope | states | transitions | depth | time | properties |", "|---|---|---|---|---|---|"]
    return "\n".join([*head, *rows, total])


def _verdict(one: Searched[World]) -> str:
    if one.violation is not None:
        return f"**{one.violation.property_name}** is broken"
    return "all hold" if one.complete else "not complete"


def mutations_table(mutations: Sequence[Mutation], found: Sequence[Searched[World]]) -> str:
    """A row for each mutation."""
    rows = []
    for mutation, one in zip(mutations, found, strict=True):
        broken = "**not caught**" if one.violation is None else one.violation.property_name
        steps = "" if one.violation is None else len(one.violation.trace) - 1
        rows.append(f"| {mutation.says} | {broken} | {steps} | {one.states:,} |")
    return "\n".join(["| change | property that it breaks | steps | states visited |", "|---|---|---|---|", *rows])
