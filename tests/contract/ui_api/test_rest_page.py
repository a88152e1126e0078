"""`docs/rest.md` lists every problem code that the gateway knows, and no other."""

import re
from pathlib import Path

from services.ui_api.core.event_data import Step
from services.ui_api.core.procedure_conditions import Judge
from services.ui_api.core.procedure_table import TABLE, decide_step
from services.ui_api.core.situation import Situation

_TOP = Path(__file__).parents[3]
_RAISED = (
    r'\b(?:conflict|invalid|forbidden|unauthenticated)\(\s*"(\w+)"',
    r'RefusalKind\.\w+,\s*"(\w+)"',
    r'\bstale_precondition\(\s*"(\w+)"',
    r'\bproblem\(\s*\d+,\s*"(\w+)"',
    r'\b_refuse\(\w+, "(\w+)"',
    r'\n        \d+,\n        "(\w+)",\n        "the header',
)
# From the shared tree of errors, and from the table of plain HTTP statuses.
_ELSEWHERE = {
    "not_found",
    "method_not_allowed",
    "body_too_large",
    "part_file_invalid",
    "message_invalid",
    "no_reply",
    "bus_unavailable",
    "record_unavailable",
}


def _known_codes() -> set[str]:
    source = "\n".join(p.read_text(encoding="utf-8") for p in (_TOP / "services" / "ui_api").rglob("*.py"))
    codes = {code for pattern in _RAISED for code in re.findall(pattern, source)}
    conditions = [one for row in TABLE.values() for one in row.conditions if one.judge is Judge.GATEWAY]
    codes |= {one.code for one in conditions} | {decide_step(Situation(), Step.FINISHED).code}
    return codes | {f"{what}_not_found" for what in re.findall(r'\bunknown\("(\w+)"', source)} | _ELSEWHERE


def test_the_page_lists_the_codes_there_are() -> None:
    page = (_TOP / "docs" / "rest.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if re.match(r"\| \d{3} \|", line)]
    listed = {code for row in rows for code in re.findall(r"`(\w+)`", row)}
    assert listed == _known_codes()
