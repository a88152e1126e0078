"""`distalock risk check` from the command line."""

import json
import time
from pathlib import Path

import pytest

from distalock.__main__ import main
from tools.risk.evidence import digest_of_sources, marked_tests


def _results(folder: Path, outcome: str) -> Path:
    rows = [
        {"test": f"{one.file}::{one.name}", "outcome": "passed", "at_s": time.time(), "sources": digest_of_sources()}
        for one in marked_tests()
    ]
    rows[0]["outcome"] = outcome
    (folder / "1.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return folder


def test_a_run_in_which_all_marked_tests_passed_is_right(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["risk", "check", "--results", str(_results(tmp_path, "passed"))]) == 0
    assert "every control has tests that ran and passed" in capsys.readouterr().out


def test_one_that_failed_is_named_with_its_hazards(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["risk", "check", "--results", str(_results(tmp_path, "failed"))]) == 1
    first = marked_tests()[0]
    assert f"{first.file}::{first.name} failed" in capsys.readouterr().err


def test_without_results_it_says_what_to_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["risk", "check", "--results", str(tmp_path)]) == 2
    assert "run `make test`" in capsys.readouterr().err
