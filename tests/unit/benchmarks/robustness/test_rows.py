"""What counts as wrong, usable and good, and the page's sections."""

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.robustness.all_kinds import KINDS
from benchmarks.robustness.page import section_of, with_section
from benchmarks.robustness.rows import HoleScore, Row, summary_of

JPEG = (KINDS["jpeg"],)


def row(axis_deg: float, codes: tuple[str, ...] = (), control: tuple[str, ...] = (), seed: int = 1) -> Row:
    holes = tuple(HoleScore(name, 0.1, axis_deg, 0.05, 0.1) for name in ("distal", "proximal"))
    return Row("jpeg", seed, {"quality": 80}, control, codes, holes, 1.0)


def test_an_accepted_row_is_wrong_when_one_axis_is_too_far_off() -> None:
    assert row(1.6).wrong
    assert row(float("nan")).wrong
    assert not row(1.4).wrong
    assert not row(1.6, codes=("clipped",)).wrong


def test_a_summary_counts_what_the_control_allows() -> None:
    rows = [row(0.1), row(0.7), row(0.1, ("clipped",)), row(0.1, ("low_dose",), control=("low_dose",))]
    summary = summary_of(rows)
    assert (summary.scenes, summary.accepted, summary.wrong) == (4, 2, 0)
    assert (summary.usable, summary.usable_accepted, summary.usable_good) == (3, 2, 1)
    assert summary.refused == (("clipped", 1), ("low_dose", 1))
    assert summary.beyond == 1
    assert summary.normalised_axis == pytest.approx(5.0)
    assert summary.normalised_entry == pytest.approx(2.0)


def test_a_section_replaces_its_own_and_keeps_the_others(tmp_path: Path) -> None:
    page = tmp_path / "robustness.md"
    page.write_text(with_section(page, "processing", section_of("processing", "1-2 (fit)", JPEG, [row(0.1)], None)))
    page.write_text(with_section(page, "bent_nails", "## bent_nails\n\nbent\n"))
    page.write_text(with_section(page, "processing", section_of("processing", "3-4 (fit)", JPEG, [row(0.2)], None)))
    text = page.read_text()
    assert text.count("# Robust on images") == 1
    assert [line for line in text.splitlines() if line.startswith("## ")] == ["## bent_nails", "## processing"]
    assert "Seeds 3-4" in text
    assert "- `jpeg`: JPEG of quality 70 to 95." in text
    assert "Seeds 1-2" not in text
    assert "| jpeg | 1 | 1 | 0 | 1: 1, 1 |" in text


def test_a_hole_that_is_mostly_covered_is_not_usable() -> None:
    half, more = (
        replace(row(0.1), drawn={"covered_distal": covered, "covered_proximal": 0.0, "width": 30})
        for covered in (0.5, 0.51)
    )
    assert half.usable
    assert not more.usable


def test_a_nail_that_is_not_as_filed_is_to_be_refused() -> None:
    within, beyond = (replace(row(0.1), drawn={"off_mm": -off_mm, "beside_file_mm": off_mm}) for off_mm in (0.2, 0.21))
    assert within.usable
    assert not beyond.usable
