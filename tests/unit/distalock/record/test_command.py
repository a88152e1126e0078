"""`distalock record`: what it prints, and its exit codes."""

import contextlib
import sqlite3
from pathlib import Path

import pytest
from sqlalchemy import text

from distalock.__main__ import main
from services.ui_api.core.event_data import GatewayStarted
from services.ui_api.core.events import EventDraft
from services.ui_api.record.database import open_database, sqlite_url
from services.ui_api.record.record import CaseRecord

_FILE = "case-record.sqlite"


@pytest.fixture
def state(tmp_path: Path) -> Path:
    """State folder of an installation with three events."""
    folder = tmp_path / "state"
    record = CaseRecord(open_database(sqlite_url(folder)), lambda: 1)
    for _ in range(3):
        record.append(EventDraft(GatewayStarted("epoch", "0.1.0"), None, "gateway"))
    record.close()
    return folder


def _run(action: str, *arguments: object, state: Path) -> int:
    return main(["record", action, *map(str, arguments), "--state", str(state)])


def test_verify_reports_an_intact_record(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run("verify", state=state) == 0
    assert capsys.readouterr().out.startswith("intact: 3 events, head ")


def test_verify_reports_a_broken_record(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with open_database(sqlite_url(state)).begin() as connection:
        connection.execute(text("DROP TRIGGER events_refuse_update"))
        connection.execute(text("UPDATE events SET who = 'nobody' WHERE sequence = 2"))
    assert _run("verify", state=state) == 1
    assert capsys.readouterr().out.startswith("broken: event 2 (gateway_started) was changed")


def test_verify_says_when_there_is_nothing_to_verify(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run("verify", state=tmp_path) == 2
    assert "distalock record verify: there is no case record at" in capsys.readouterr().err
    (tmp_path / _FILE).write_bytes(b"no database at all" * 100)
    assert _run("verify", state=tmp_path) == 2
    assert "cannot be read: file is not a database" in capsys.readouterr().err


def test_verify_says_when_a_record_cannot_be_read(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = state / _FILE
    with contextlib.closing(sqlite3.connect(file)) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    file.write_bytes(file.read_bytes().replace(b"CREATE TABLE documents", b"CREATE \xff\xfe\xfdLE documents"))
    assert _run("verify", state=state) == 2
    said = capsys.readouterr().err
    assert "cannot be read" in said
    assert len(said.splitlines()) == 1


def test_a_backup_is_restored(state: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run("backup", tmp_path / "backup", state=state) == 0
    made = capsys.readouterr().out
    assert made.startswith("backed up: 3 events, head ")
    assert _run("restore", tmp_path / "backup", state=tmp_path / "other") == 0
    head = made.split()[5].rstrip(",")
    assert capsys.readouterr().out == f"restored: 3 events, head {head}\n"
    assert _run("restore", tmp_path / "backup", state=state) == 2
    assert "restore onto an empty machine" in capsys.readouterr().err
