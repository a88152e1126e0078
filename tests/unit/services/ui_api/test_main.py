"""The gateway's command: what cannot start says so in one sentence, with exit code 2."""

import contextlib
import json
import sqlite3
from pathlib import Path

import pytest
from sqlalchemy import text

from services.ui_api.__main__ import main
from services.ui_api.core.event_data import GatewayStarted
from services.ui_api.core.events import EventDraft
from services.ui_api.record.database import open_database, sqlite_url
from services.ui_api.record.record import CaseRecord
from services.ui_api.server import listening_socket
from shared.errors import ConfigurationError


def _record_with_events(state_dir: Path) -> None:
    record = CaseRecord(open_database(sqlite_url(state_dir)), lambda: 1)
    for _ in range(3):
        record.append(EventDraft(GatewayStarted("epoch", "0.1.0"), None, "gateway"))
    record.close()


def test_a_port_in_use_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with listening_socket("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        assert main(["--port", str(port), "--state-dir", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"cannot listen on 127.0.0.1 port {port} (Address already in use)" in said
    assert list(tmp_path.iterdir()) == [], "nothing is begun"


def test_an_address_of_another_machine_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"cannot listen on 192\.0\.2\.1 port 0"):
        listening_socket("192.0.2.1", 0)


def test_a_wrong_setting_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--port", "70000"]) == 2
    assert "setting 'port': Input should be less than or equal to 65535" in capsys.readouterr().err


def test_verify_reports_an_intact_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _record_with_events(tmp_path)
    assert main(["verify", "--state-dir", str(tmp_path)]) == 0
    assert capsys.readouterr().out.startswith("intact: 3 events, head ")


def test_verify_reports_a_broken_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _record_with_events(tmp_path)
    with open_database(sqlite_url(tmp_path)).begin() as connection:
        connection.execute(text("DROP TRIGGER events_refuse_update"))
        connection.execute(text("UPDATE events SET who = 'nobody' WHERE sequence = 2"))
    assert main(["verify", "--state-dir", str(tmp_path)]) == 1
    assert capsys.readouterr().out.startswith("broken: event 2 (gateway_started) was changed")


def test_verify_says_when_there_is_nothing_to_verify(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", "--state-dir", str(tmp_path)]) == 2
    assert "there is no case record at" in capsys.readouterr().err
    (tmp_path / "case-record.sqlite").write_bytes(b"no database at all" * 100)
    assert main(["verify", "--state-dir", str(tmp_path)]) == 2
    assert "cannot be read: file is not a database" in capsys.readouterr().err


def test_verify_says_when_a_record_cannot_be_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _record_with_events(tmp_path)
    file = tmp_path / "case-record.sqlite"
    with contextlib.closing(sqlite3.connect(file)) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    file.write_bytes(file.read_bytes().replace(b"CREATE TABLE documents", b"CREATE \xff\xfe\xfdLE documents"))
    assert main(["verify", "--state-dir", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "cannot be read" in said
    assert len(said.splitlines()) == 1


def test_openapi_prints_the_document(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["openapi"]) == 0
    assert "/api/v1/cases" in json.loads(capsys.readouterr().out)["paths"]
