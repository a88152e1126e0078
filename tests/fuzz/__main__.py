"""`make fuzz`: generated requests as each role, along the links of the interface's document.

usage: python -m tests.fuzz [--site gateway|installation] [--examples 40] [--seed 1] [--role ROLE] [--phases stateful]
           [--seconds S] [--logs FOLDER] [--report FILE]

Exit code 1 when anything was found.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from services.ui_api.api_document.links import LINKS
from services.ui_api.core.roles import Role
from tests.fuzz.gateway_site import gateway_site
from tests.fuzz.page import PAGE, page_text
from tests.fuzz.runner import ALL_PHASES, STREAMS, FuzzPlan, RoleRun, kept_runs, run_as, write_run
from tests.fuzz.site import installation_site

# Chosen: with four roles, more than 10,000 requests.
_EXAMPLES: Final = 40
_SITES: Final = {"gateway": gateway_site, "installation": installation_site}


def main(arguments: Sequence[str] | None = None) -> int:
    """Ask as each role."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="generated requests as each role")
    parser.add_argument("--examples", type=int, default=_EXAMPLES, help="requests generated for each operation")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--role", type=Role, choices=tuple(Role), action="append", help="only this one")
    parser.add_argument("--logs", type=Path, help="where what was found goes; the page is of all roles that are there")
    parser.add_argument("--seconds", type=int, help="as each role; generated requests are repeated until then")
    parser.add_argument("--report", type=Path, default=PAGE)
    parser.add_argument("--phases", choices=ALL_PHASES, action="append", help="only this one; may be repeated")
    parser.add_argument("--site", choices=tuple(_SITES), default="gateway", help="what is asked (gateway)")
    asked = parser.parse_args(arguments)
    if asked.logs is not None:
        asked.logs.mkdir(parents=True, exist_ok=True)
    plan, runs = FuzzPlan(asked.examples, asked.seed, tuple(asked.phases or ALL_PHASES), asked.seconds), list[RoleRun]()
    with tempfile.TemporaryDirectory() as folder, _SITES[asked.site]() as site:
        for role in asked.role or Role:
            runs.append(_told(run_as(role, site, plan, asked.logs or Path(folder))))
            if asked.logs is not None:
                write_run(runs[-1], asked.logs)
    if asked.logs is not None:
        runs = kept_runs(asked.logs)
    if len(runs) == len(Role) and asked.phases is None:
        in_document = sum(link.target not in STREAMS for link in LINKS)
        asked.report.write_text(page_text(runs, plan, in_document, asked.site), encoding="utf-8")
    return 1 if any(run.failed or run.beyond for run in runs) else 0


def _told(run: RoleRun) -> RoleRun:
    answers = ", ".join(f"{count} × {status}" for status, count in sorted(run.answers.items()))
    print(f"{'found' if run.failed else 'held':6} {run.role}: {run.cases} requests: {answers}", flush=True)
    print(
        f"       {run.took_s:.0f} s, {run.cases / run.took_s:.1f} requests/s; {run.sequences} sequences along "
        f"{len(run.links)} links, {run.links.total()} times, {run.links_that_succeeded.total()} to a good answer, "
        f"the longest of {run.longest}",
        flush=True,
    )
    if run.failed:
        print(run.output[-6000:], flush=True)
    return run


if __name__ == "__main__":
    sys.exit(main())
