"""Logging never raises, whatever is logged and wherever it goes."""

import json
import logging
from pathlib import Path

import pytest

from shared.runtime.logging import Log, configure_logging, dropped_lines, flush_logs


def lines(path: Path) -> list[dict[str, object]]:
    flush_logs()
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_lines_name_where_they_come_from(tmp_path: Path) -> None:
    path = tmp_path / "robot.jsonl"
    configured(path).info("state", state="locked")
    logging.getLogger("library").warning("odd")
    ours, theirs = lines(path)
    assert (ours["event"], ours["state"]) == ("state", "locked")
    for line in (ours, theirs):
        assert (line["service"], line["room"], line["boot_epoch"]) == ("robot", "or1", "epoch-1")


def configured(path: Path) -> Log:
    """Logging of a process, without the handlers of the test runner."""
    logging.getLogger().handlers = []
    return configure_logging("robot", "or1", "epoch-1", "info", path)


class _Unshowable:
    def __repr__(self) -> str:
        raise ZeroDivisionError


def test_a_value_that_cannot_be_shown_is_a_dropped_line(tmp_path: Path) -> None:
    path = tmp_path / "robot.jsonl"
    log = configured(path)
    log.info("odd", value=_Unshowable())
    log.info("next")
    notice, following = lines(path)
    assert (notice["event"], notice["count"], notice["service"]) == ("log lines dropped", 1, "robot")
    assert following["event"] == "next"
    assert dropped_lines() == (1, "a line could not be made: ZeroDivisionError")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_a_dropped_line(tmp_path: Path) -> None:
    path = tmp_path / "robot.jsonl"
    path.symlink_to("/dev/full")
    log = configured(path)
    for _ in range(3):
        log.info("state")
    flush_logs()
    count, why = dropped_lines()
    assert count == 3
    assert "No space left on device" in why
