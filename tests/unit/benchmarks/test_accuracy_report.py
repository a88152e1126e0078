"""Rows on file and the tables made of them."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks.accuracy.accuracy import main, summary_of
from benchmarks.accuracy.capture import Capture
from benchmarks.accuracy.localised_scenes import SceneKind, SceneRow
from benchmarks.accuracy.report import limit_ratios
from benchmarks.accuracy.rows import EarlierLimits, StoredRow, read_rows, write_row
from benchmarks.baselines.methods import HoleError, Outcome
from benchmarks.limits.cramer_rao import AxisLimit
from distalock.__main__ import main as command
from shared.errors import InputError

KIND = SceneKind(3.0, 400.0, 1, 0.3, "steel", 11.0, False, 5.5, 0.5, 0.1, 20.0)


def row(seed: int, entry_mm: float, axis_deg: float, *codes: str) -> SceneRow:
    """A scene whose two holes are off alike, with the same prediction everywhere."""
    holes = (HoleError(entry_mm, axis_deg, 0.05, 0.1),) * 2
    rule = Outcome((), (HoleError(0.3, 2.0, None, None),) * 2, 1.0)
    limits = (AxisLimit("distal", 0.08, 0.01),) * 2
    return SceneRow(seed, KIND, Outcome(codes, holes, 2.0), rule, None, Capture.RIGHT, limits, 0.02)


def test_rows_are_read_as_they_were_written_and_a_broken_line_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    written = [StoredRow("abc", row(seed, 0.05, 0.1)) for seed in (5, 6)]
    for one in written:
        write_row(file, one)
    file.write_text(file.read_text() + '{"revision": "abc", "row"')
    assert read_rows(file) == written


def test_a_run_whose_rows_are_all_there_only_reports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows, page = tmp_path / "rows.jsonl", tmp_path / "page.md"
    for seed in range(40, 50):
        write_row(rows, StoredRow("abc", row(seed, 0.05, 0.12)))
    assert main(["--seed", "40", "--count", "10", "--rows", str(rows), "--report", str(page)]) == 0
    text = page.read_text()
    assert "10 scenes are known" in capsys.readouterr().out
    assert "| model | 10 of 10 | 0 | 0.050 / 0.050 / 0.050 | 0.120 / 0.120 / 0.120 | 1.00, 1.20 | 2.00 | 100 |" in text
    assert "| paper | 10 of 10 | 10 | 0.300 / 0.300 / 0.300 | 2.000 / 2.000 / 2.000 | - | 1.00 | 50 |" in text
    assert "| right | 10 | 0 | 10 |" in text
    assert "| error over limit, rms over 10 accepted scenes | 1.50 |" in text
    for name in ("accuracy-errors.png", "accuracy-honesty.png"):
        assert name in text
        assert np.asarray(Image.open(tmp_path / name).convert("L")).std() > 5.0


def written(file: Path, rows: Iterable[StoredRow]) -> Path:
    for one in rows:
        write_row(file, one)
    return file


def without_limits(seed: int, revision: str) -> StoredRow:
    return StoredRow(revision, replace(row(seed, 0.05, 0.12), limits=None))


def test_limits_of_an_earlier_run_are_taken_and_said_to_be_from_there(tmp_path: Path) -> None:
    file = written(tmp_path / "earlier.jsonl", [StoredRow("old", row(1, 9.0, 9.0)), without_limits(2, "old")])
    limits = EarlierLimits(file)
    assert limits.seeds == {1}
    now = limits.added_to(without_limits(1, "new"))
    assert now.row == row(1, 0.05, 0.12)
    assert now.sources == ("new", "limits of old")
    again = EarlierLimits(written(tmp_path / "now.jsonl", [now])).added_to(without_limits(1, "newest"))
    assert again.sources == ("newest", "limits of old")
    for untouched in (StoredRow("new", row(1, 0.05, 0.1)), without_limits(2, "new")):
        assert limits.added_to(untouched) == untouched
        assert untouched.sources == ("new",)


def test_a_report_names_the_sources_of_limits_though_all_rows_were_there(tmp_path: Path) -> None:
    earlier = written(tmp_path / "earlier.jsonl", [StoredRow("old", row(seed, 9.0, 9.0)) for seed in range(40, 50)])
    rows = written(tmp_path / "rows.jsonl", [without_limits(seed, "new") for seed in range(40, 50)])
    page = tmp_path / "page.md"
    options = ["--seed", "40", "--count", "10", "--rows", str(rows), "--report", str(page)]
    assert main([*options, "--limits", str(earlier)]) == 0
    assert "new, limits of old" in page.read_text()
    assert "| error over limit, rms over 10 accepted scenes | 1.50 |" in page.read_text()


def test_limits_of_another_scene_and_files_without_any_are_refused(tmp_path: Path) -> None:
    other = StoredRow("old", replace(row(1, 0.05, 0.1), kind=replace(KIND, tilt_deg=4.0)))
    with pytest.raises(InputError, match="seed 1 was another scene"):
        EarlierLimits(written(tmp_path / "other.jsonl", [other])).added_to(without_limits(1, "new"))
    with pytest.raises(InputError, match="none of its 1 rows has limits"):
        EarlierLimits(written(tmp_path / "none.jsonl", [without_limits(1, "old")]))


def test_an_accepted_axis_that_is_off_is_wrong_and_a_refused_one_is_not(tmp_path: Path) -> None:
    rows = [row(1, 0.05, 0.1), row(2, 0.05, 1.6), row(3, 1.1, 0.1, "mirror_ambiguous"), row(4, 1.1, 0.1)]
    found = summary_of(rows)
    assert (found.scenes, found.accepted, found.wrong) == (4, 3, 2)
    assert found.refused_by_code == {"mirror_ambiguous": 1}
    file = tmp_path / "rows.jsonl"
    for one in rows:
        write_row(file, StoredRow("abc", one))
    page = tmp_path / "page.md"
    assert main(["--seed", "1", "--count", "4", "--rows", str(file), "--report", str(page)]) == 1


def test_only_accepted_scenes_are_held_against_the_limit() -> None:
    assert limit_ratios([row(1, 0.05, 0.16), row(2, 0.05, 0.9, "mirror_ambiguous")]) == pytest.approx([2.0])


def test_options_reach_the_benchmark(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows, page = tmp_path / "rows.jsonl", tmp_path / "page.md"
    write_row(rows, StoredRow("abc", row(9, 0.05, 0.1)))
    words = ["--count", "1", "--seed", "9", "--rows", str(rows), "--report", str(page)]
    assert command(["bench", "accuracy", *words]) == 0
    assert "1 of 1 scenes are known" in capsys.readouterr().out
    assert page.read_text().startswith("# Accuracy on random scenes")
