"""`docs/benchmarks/rest-fuzz.md`: what generated requests found. Pure."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from tests.fuzz.runner import CHECKS, FuzzPlan, RoleRun

PAGE: Final = Path(__file__).parents[2] / "docs" / "benchmarks" / "rest-fuzz.md"

_PAGE: Final = """# Generated requests

`make fuzz` (seed {seed}, {examples} generated requests for each operation beside those of the other phases,
{minutes:.0f} min, {rate:.0f} requests a second).
[Schemathesis](https://schemathesis.readthedocs.io) reads `/openapi.json` of {site}
and asks as each role: the document's examples, values at the edges of every schema, generated ones, and sequences
along the links ([decision 44](../decisions/0044-generated-requests.md)). Each role begins with an open case, an image
and a plan. Half of the requests name a case, an image, a plan and an operation that exist, and quote the newest ETag.
Rate limits are off. Streams of events are left out: they have no end.

**{total} requests: {errors} answers of 5xx, {beyond} granted beyond the role; {found}** (checks: {checks}).

| role | requests | 2xx | 3xx | 4xx | 5xx | `/readyz`: not ready | beyond the role |
|---|---|---|---|---|---|---|---|
{rows}

The 5xx do not count `GET /readyz`, where 503 is the answer that the document names while a part is not ready, as a
robot in fault is: it is accepted there alone, and only with the code `not_ready` and a part that is named.

## Sequences along the links

| role | sequences | links followed | different links | to an answer below 400 | inferred links | longest sequence |
|---|---|---|---|---|---|---|
{sequences}

{different} different links were followed, {succeeded} of them at least once to an answer below 400; the document has
{in_document} whose target is not a stream. Inferred links are those that Schemathesis guesses from names beside.
"""


_SITES: Final = {
    "gateway": "a gateway, front and application as installed, whose imaging and registration are scripted and whose "
    "robot is a state machine",
    "installation": "an installation with the virtual operating room",
}


def page_text(runs: Sequence[RoleRun], plan: FuzzPlan, in_document: int, site: str) -> str:
    """The page."""
    total, errors = sum(run.cases for run in runs), sum(run.server_errors for run in runs)
    beyond, took_s = sum(len(run.beyond) for run in runs), sum(run.took_s for run in runs)
    links = sum((run.links for run in runs), Counter[str]())
    succeeded = sum((run.links_that_succeeded for run in runs), Counter[str]())
    return _PAGE.format(
        site=_SITES[site],
        seed=plan.seed,
        examples=plan.examples,
        minutes=took_s / 60,
        rate=total / took_s,
        total=total,
        errors=errors,
        beyond=beyond,
        checks=", ".join(f"`{name}`" for name in CHECKS),
        found=_found(runs),
        rows="\n".join(map(_row, runs)),
        sequences="\n".join(map(_sequences, runs)),
        different=len(links),
        succeeded=len(succeeded),
        in_document=in_document,
    )


def _row(run: RoleRun) -> str:
    counts = " | ".join(str(_of(run, first)) for first in "234")
    return f"| {run.role} | {run.cases} | {counts} | {run.server_errors} | {run.not_ready} | {len(run.beyond)} |"


def _sequences(run: RoleRun) -> str:
    steps = f"{run.links.total()} | {len(run.links)} | {run.links_that_succeeded.total()} | {run.inferred}"
    return f"| {run.role} | {run.sequences} | {steps} | {run.longest} |"


def _found(runs: Sequence[RoleRun]) -> str:
    failed = ", ".join(str(run.role) for run in runs if run.failed)
    return f"Schemathesis found more as {failed}" if failed else "every answer is as the document says"


def _of(run: RoleRun, first: str) -> int:
    return sum(count for status, count in run.answers.items() if status.startswith(first))
