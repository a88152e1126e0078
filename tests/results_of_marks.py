"""How tests that carry the mark of a requirement ended, a JSON line each, for `distalock risk check`.

`make test` names the folder in `REQUIREMENTS_RESULTS`; without it nothing is written. Workers pass the marks on with
their reports; the process that collects the reports writes.
"""

import json
import os
import time
from pathlib import Path

import pytest

from tools.risk.evidence import digest_of_sources

_VARIABLE = "REQUIREMENTS_RESULTS"


def begin(config: pytest.Config) -> None:
    """Pass marks on, and write if a folder is named and this process collects the reports."""
    config.pluginmanager.register(_Marks())
    folder = os.environ.get(_VARIABLE)
    if folder and not hasattr(config, "workerinput"):
        config.pluginmanager.register(_Writer(Path(folder)))


class _Marks:
    """Every report of a test carries the requirements that its marks name."""

    def pytest_itemcollected(self, item: pytest.Item) -> None:
        item.user_properties += [("requirement", mark.args[0]) for mark in item.iter_markers("requirement")]


class _Writer:
    """One file for each run of pytest: several run at the same time."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._file = folder / f"{time.time_ns()}-{os.getpid()}.jsonl"
        self._sources = digest_of_sources()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if not any(name == "requirement" for name, _ in report.user_properties):
            return
        if report.when == "call" or report.outcome != "passed":
            row = {"test": report.nodeid, "outcome": report.outcome, "at_s": time.time(), "sources": self._sources}
            with self._file.open("a", encoding="utf-8") as lines:
                lines.write(json.dumps(row) + "\n")
