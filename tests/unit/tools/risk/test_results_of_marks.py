"""What a run of pytest leaves for the check: a line for each test with a mark, also from workers."""

import json
import os
import subprocess
import sys
from pathlib import Path

_TESTS = """
import pytest

@pytest.mark.requirement("ROB-01")
@pytest.mark.parametrize("number", [1, 2])
def test_shows(number):
    assert number < 3

@pytest.mark.requirement("ROB-02")
def test_fails():
    assert False

@pytest.mark.requirement("ROB-03")
@pytest.mark.skip(reason="no images")
def test_skips():
    pass

def test_shows_nothing():
    pass
"""


def test_marked_tests_leave_a_line_each_also_those_of_workers(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(_TESTS)
    (tmp_path / "conftest.py").write_text(
        "from tests import results_of_marks\n\n\ndef pytest_configure(config):\n    results_of_marks.begin(config)\n"
    )
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = requirement(id): shows one\n")
    folder = tmp_path / "results"
    root = str(Path(__file__).parents[4])
    subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n", "1", str(tmp_path)],
        env=os.environ | {"REQUIREMENTS_RESULTS": str(folder), "PYTHONPATH": root},
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        check=False,
    )
    (file,) = folder.iterdir()
    rows = [json.loads(line) for line in file.read_text().splitlines()]
    assert sorted((row["test"], row["outcome"]) for row in rows) == [
        ("test_it.py::test_fails", "failed"),
        ("test_it.py::test_shows[1]", "passed"),
        ("test_it.py::test_shows[2]", "passed"),
        ("test_it.py::test_skips", "skipped"),
    ]
