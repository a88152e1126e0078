"""`make fuzz`: generated requests as each role, along the links of the interface's document.

usage: python -m tests.fuzz [--examples 60] [--seed 1] [--role ROLE] [--logs FOLDER] [--report FILE]

Exit code 1 when anything was found.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from services.ui_api.core.roles import Role
from tests.fuzz.page import PAGE, page_text
from tests.fuzz.runner import RoleRun, run_as
from tests.fuzz.site import fuzz_site

# Chosen: with four roles, more than 10,000 requests.
_EXAMPLES: Final = 60


def main(arguments: Sequence[str] | None = None) -> int:
    """Ask as each role."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="generated requests as each role")
    parser.add_argument("--examples", type=int, default=_EXAMPLES, help="requests generated for each operation")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--role", type=Role, choices=tuple(Role), action="append", help="only this one")
    parser.add_argument("--logs", type=Path, help="where what was found goes")
    parser.add_argument("--report", type=Path, default=PAGE)
    asked = parser.parse_args(arguments)
    began_s, runs = time.monotonic(), list[RoleRun]()
    with tempfile.TemporaryDirectory() as folder, fuzz_site() as site:
        for role in asked.role or Role:
            runs.append(_told(run_as(role, site, asked.examples, asked.seed, asked.logs or Path(folder))))
            if asked.logs is not None:
                (asked.logs / f"{role}.txt").write_text(runs[-1].output, encoding="utf-8")
    if asked.role is None:
        asked.report.write_text(
            page_text(runs, asked.examples, asked.seed, time.monotonic() - began_s), encoding="utf-8"
        )
    return 1 if any(run.failed or run.beyond for run in runs) else 0


def _told(run: RoleRun) -> RoleRun:
    answers = ", ".join(f"{count} × {status}" for status, count in sorted(run.answers.items()))
    print(f"{'found' if run.failed else 'held':6} {run.role}: {run.cases} requests: {answers}", flush=True)
    if run.failed:
        print(run.output[-6000:], flush=True)
    return run


if __name__ == "__main__":
    sys.exit(main())
