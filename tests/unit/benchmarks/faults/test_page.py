"""The table of findings."""

from dataclasses import replace
from datetime import date

from benchmarks.common.places import ROOT
from benchmarks.faults.combination import Finding
from benchmarks.faults.page import BEGIN, END, finding_line, rows_of, with_table
from benchmarks.faults.table import FAULTS

FINDING = Finding(FAULTS[0].name, "moving", (), ("motion stopped",), 0.21, 0.4, 3.2, 1.0)
PAGE = f"before\n{BEGIN}\nold\n{END}\nafter\n"


def test_the_table_has_a_row_for_each_fault_and_the_rest_of_the_page_stays() -> None:
    page = with_table(PAGE, [FINDING], date(2026, 11, 25))
    assert rows_of(page) == [fault.name for fault in FAULTS]
    assert page.startswith(f"before\n{BEGIN}\n2026-11-25: 1 of 1 combinations survived.")
    assert page.endswith(f"{END}\nafter\n")
    assert "| 0.21, 3 |" in page
    assert "old" not in page


def test_what_was_not_survived_is_marked_and_explained() -> None:
    lost = replace(FINDING, wrong=("acknowledged and lost: x",), safe_s=None)
    page = with_table(PAGE, [lost], date(2026, 11, 25))
    assert "0 of 1 combinations survived" in page
    assert "| **never, 3** |" in page
    assert f"- {FAULTS[0].name}, moving: acknowledged and lost: x" in page


def test_a_line_names_fault_step_verdict_and_figures() -> None:
    line = finding_line(FINDING)
    for word in ("survived", FAULTS[0].name, "moving", "0.21 s", "3.2 s", "motion stopped"):
        assert word in line
    assert "FAILED" in finding_line(replace(FINDING, wrong=("lost",)))


def test_the_page_of_faults_has_the_faults_that_are_declared() -> None:
    page = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
    assert rows_of(page) == [fault.name for fault in FAULTS], "run: make faults"
