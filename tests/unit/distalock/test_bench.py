"""`distalock bench`: options go to the benchmark that has some, and to no other."""

from pathlib import Path

import pytest

from benchmarks.accuracy import StoredRow, write_row
from distalock.__main__ import main
from distalock.bench import EXIT_BAD_INPUT
from tests.unit.benchmarks.test_accuracy_report import row


def test_options_reach_the_benchmark(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows, page = tmp_path / "rows.jsonl", tmp_path / "page.md"
    write_row(rows, StoredRow("abc", row(9, 0.05, 0.1)))
    words = ["--count", "1", "--seed", "9", "--rows", str(rows), "--report", str(page)]
    assert main(["bench", "accuracy", *words]) == 0
    assert "1 of 1 scenes are known" in capsys.readouterr().out
    assert page.read_text().startswith("# Accuracy on random scenes")


@pytest.mark.parametrize("names", [["calibration"], ["accuracy", "calibration"]])
def test_others_have_none(names: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", *names, "--count", "1"]) == EXIT_BAD_INPUT
    assert "options go to one of the benchmarks that have some (accuracy)" in capsys.readouterr().err
