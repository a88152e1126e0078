"""`docs/procedure.md` is printed from the procedure's tables, and its diagram shows every phase."""

import re
from pathlib import Path

from services.ui_api.core.next_step import Phase
from tools.procedure_page import procedure_page

_PAGE = Path(__file__).parents[3] / "docs" / "procedure.md"


def test_the_page_is_up_to_date() -> None:
    assert _PAGE.read_text(encoding="utf-8") == procedure_page(), "run: make generated"


def test_every_phase_is_in_the_diagram_and_leads_on() -> None:
    arrows = re.findall(r"^    (\S+) --> ([^\s:]+)", procedure_page(), re.MULTILINE)
    reached, left = {after for _, after in arrows}, {before for before, _ in arrows}
    assert reached >= set(Phase)
    assert left >= set(Phase)
