"""`docs/benchmarks/rest-fuzz.md`: what generated requests found. Pure."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from tests.fuzz.runner import CHECKS, RoleRun

PAGE: Final = Path(__file__).parents[2] / "docs" / "benchmarks" / "rest-fuzz.md"

_PAGE: Final = """# Generated requests

`make fuzz` (seed {seed}, {examples} generated requests for each operation, {minutes:.0f} min).
[Schemathesis](https://schemathesis.readthedocs.io) reads `/openapi.json` of an installation with the virtual operating
room and asks as each role: the document's examples, values at the edges of every schema, generated ones, and sequences
along the links ([decision 44](../decisions/0044-generated-requests.md)). Half of the requests name a case, an image, a
plan and an operation that exist, and quote the newest ETag. Rate limits are off. Streams of events are left out: they
have no end.

**{total} requests: {errors} answers of 5xx, {beyond} granted beyond the role; {found}** (checks: {checks}).

| role | requests | 2xx | 3xx | 4xx | 5xx | beyond the role |
|---|---|---|---|---|---|---|
{rows}
"""


def page_text(runs: Sequence[RoleRun], examples: int, seed: int, took_s: float) -> str:
    """The page."""
    total, errors = sum(run.cases for run in runs), sum(run.server_errors for run in runs)
    beyond = sum(len(run.beyond) for run in runs)
    rows = "\n".join(
        f"| {run.role} | {run.cases} | {' | '.join(str(_of(run, first)) for first in '2345')} | {len(run.beyond)} |"
        for run in runs
    )
    return _PAGE.format(
        seed=seed,
        examples=examples,
        minutes=took_s / 60,
        total=total,
        errors=errors,
        beyond=beyond,
        checks=", ".join(f"`{name}`" for name in CHECKS),
        found=_found(runs),
        rows=rows,
    )


def _found(runs: Sequence[RoleRun]) -> str:
    failed = ", ".join(str(run.role) for run in runs if run.failed)
    return f"Schemathesis found more as {failed}" if failed else "every answer is as the document says"


def _of(run: RoleRun, first: str) -> int:
    return sum(count for status, count in run.answers.items() if status.startswith(first))
