"""Findings as lines for people, and as the table in docs/faults.md."""

import re
from collections.abc import Sequence
from datetime import date
from typing import Final

from benchmarks.faults.combination import Finding
from benchmarks.faults.patient import STEPS
from benchmarks.faults.table import FAULTS

BEGIN: Final = "<!-- begin: distalock bench faults -->"
END: Final = "<!-- end: distalock bench faults -->"
_NOT_TRIED: Final = "-"
_MOST_SAID: Final = 160


def finding_line(finding: Finding) -> str:
    """Fault, step, verdict, seconds to safe and to ready, and what happened."""
    safe = "never" if finding.safe_s is None else f"{finding.safe_s:.2f} s"
    verdict = "survived" if finding.survived else "FAILED"
    happened = "; ".join(finding.wrong or finding.said)
    shown = happened if finding.wrong else happened[:_MOST_SAID]
    return (
        f"{verdict:8}  {finding.fault:28} {finding.step:12} safe {safe}, {finding.travel_mm:.2f} mm; "
        f"ready {finding.ready_s:.1f} s  {shown}"
    ).rstrip()


def with_table(page: str, findings: Sequence[Finding], today: date) -> str:
    """The page with the table between its marks made anew."""
    table = "\n".join([BEGIN, *_lines(findings, today), END])
    return re.sub(f"{re.escape(BEGIN)}.*{re.escape(END)}", lambda _: table, page, flags=re.DOTALL)


def rows_of(page: str) -> list[str]:
    """Names of the faults in the table of a page."""
    table = page.partition(BEGIN)[2].partition(END)[0]
    return [line.split(" | ")[0].removeprefix("| ") for line in table.splitlines() if line.startswith("| ")][1:]


def _lines(findings: Sequence[Finding], today: date) -> list[str]:
    by_place = {(finding.fault, finding.step): finding for finding in findings}
    survived = sum(finding.survived for finding in findings)
    return [
        f"{today.isoformat()}: {survived} of {len(findings)} combinations survived.",
        "",
        f"| fault | {' | '.join(STEPS)} |",
        "|---" * (len(STEPS) + 1) + "|",
        *(f"| {f.name} | {' | '.join(_cell(by_place.get((f.name, step))) for step in STEPS)} |" for f in FAULTS),
        "",
        *(_failure(finding) for finding in findings if not finding.survived),
    ]


def _cell(finding: Finding | None) -> str:
    if finding is None:
        return _NOT_TRIED
    safe = "never" if finding.safe_s is None else f"{finding.safe_s:.2f}"
    figures = f"{safe}, {finding.ready_s:.0f}"
    return figures if finding.survived else f"**{figures}**"


def _failure(finding: Finding) -> str:
    return f"- {finding.fault}, {finding.step}: {'; '.join(finding.wrong)}"
