"""`distalock record`: what it prints, and its exit codes."""

import contextlib
import re
import sqlite3
from pathlib import Path

import pytest
from sqlalchemy import text

from distalock.__main__ import main
from services.imaging.devices.image_index import ImageIndex
from services.ui_api.core.event_data import GatewayStarted, Step, StepRecorded
from services.ui_api.core.events import EventDraft
from services.ui_api.record.database import open_database, sole_gateway, sqlite_url
from services.ui_api.record.record import CaseRecord
from shared.parts.files import sha256_of
from tests.unit.services.ui_api.record.filled import fill, record_of
from tests.unit.services.ui_api.record.handed_over import put_image

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
    assert "cannot be used: file is not a database" in capsys.readouterr().err


def test_verify_says_when_a_record_cannot_be_read(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = state / _FILE
    with contextlib.closing(sqlite3.connect(file)) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    file.write_bytes(file.read_bytes().replace(b"CREATE TABLE documents", b"CREATE \xff\xfe\xfdLE documents"))
    assert _run("verify", state=state) == 2
    said = capsys.readouterr().err
    assert "cannot be used" in said
    assert len(_sentences(said)) == 1


def test_a_backup_is_restored(state: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run("backup", tmp_path / "backup", state=state) == 0
    made = capsys.readouterr().out
    assert made.startswith("backed up: 3 events, head ")
    assert _run("restore", tmp_path / "backup", state=tmp_path / "other") == 0
    head = made.split()[5].rstrip(",")
    assert capsys.readouterr().out == f"restored: 3 events, head {head}\n"
    assert _run("restore", tmp_path / "backup", state=state) == 2
    assert "restore onto an empty machine" in capsys.readouterr().err


def test_a_kept_index_of_images_is_reported(state: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (state / "images").mkdir()
    index = ImageIndex(state / "images" / "index.sqlite")
    index.add(1, "a" * 64, b"", in_run=False)
    assert _run("backup", tmp_path / "backup", state=state) == 0
    for number in (2, 3):
        index.add(number, "b" * 64, b"", in_run=False)
    for file in state.glob(f"{_FILE}*"):
        file.unlink()
    assert _run("restore", tmp_path / "backup", state=state) == 0
    assert f"kept: the index of images in {state / 'images'}, which ends with number 3; the backup's ends with 1" in (
        capsys.readouterr().out
    )
    assert index.newest_sequence() == 3


@pytest.mark.parametrize(("action", "head"), [("export", r" --head [0-9a-f]{64}"), ("anonymise", "")])
def test_what_is_to_be_sent_another_way_is_printed(
    state: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], action: str, head: str
) -> None:
    _a_closed_case(state)
    assert _run(action, "case-1", "--out", tmp_path / "out", state=state) == 0
    sums = sha256_of((tmp_path / "out" / "SHA256SUMS").read_bytes())
    last = capsys.readouterr().out.splitlines()[-1]
    assert re.fullmatch(rf"send another way: python3 check\.py --sums {sums} --events 3{head}", last), last


def _cut_the_end(state: Path) -> None:
    with open_database(sqlite_url(state)).begin() as connection:
        connection.execute(text("DROP TRIGGER events_refuse_delete"))
        connection.execute(text("DELETE FROM events WHERE sequence = 3"))


def test_a_cut_end_shows_with_anchors_alone(state: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    key, anchors = tmp_path / "apart" / "anchor.pem", tmp_path / "apart" / "anchors.jsonl"
    given = ("--anchors", anchors, "--key", key)
    assert _run("anchor", *given, state=state) == 0
    assert _run("anchor", *given, state=state) == 0
    said = capsys.readouterr().out
    assert f"made key {key}, and anchor.pub beside it" in said
    assert "anchored: 3 events, head " in said
    verifying = ("--anchors", anchors, "--public-key", key.with_suffix(".pub"))
    assert _run("verify", *verifying, state=state) == 0
    _cut_the_end(state)
    assert _run("verify", state=state) == 0, "the chain alone does not show it"
    assert _run("verify", *verifying, state=state) == 1
    assert "the end was cut off: the record has 2 events, and had 3 at " in capsys.readouterr().out
    assert _run("anchor", *given, state=state) == 1, "what does not hold is not countersigned"


def test_anchors_of_another_key_or_none_are_refused(
    state: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("one", "other"):
        assert (
            _run("anchor", "--anchors", tmp_path / f"{name}.jsonl", "--key", tmp_path / f"{name}.pem", state=state) == 0
        )
    verifying = ("--anchors", tmp_path / "one.jsonl", "--public-key", tmp_path / "other.pub")
    assert _run("verify", *verifying, state=state) == 1
    assert "anchor 1 is not signed by the key" in capsys.readouterr().out
    (tmp_path / "one.pem").chmod(0o644)
    assert _run("anchor", "--anchors", tmp_path / "one.jsonl", "--key", tmp_path / "one.pem", state=state) == 2
    assert "can be read by others" in capsys.readouterr().err
    (tmp_path / "one.jsonl").write_text("{}\n")
    assert _run("verify", *verifying, state=state) == 2
    assert "line 1 of" in capsys.readouterr().err
    assert _run("verify", "--anchors", tmp_path / "one.jsonl", state=state) == 2


def _a_closed_case(state: Path) -> None:
    record = record_of(open_database(sqlite_url(state)))
    fill(record)
    record.append(EventDraft(StepRecorded(Step.ABANDONED, (), True, ""), "case-1", "Dr A"))
    record.close()


def test_prune_only_lists_unless_told_by_whom(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _a_closed_case(state)
    assert _run("prune", state=state) == 0
    said = capsys.readouterr().out
    assert "case case-1: 3 events, 4 documents, 0 images (cases that have been closed for 3653 days)" in said
    assert "nothing was changed" in said
    assert _run("prune", "--apply", state=state) == 2
    assert "--apply needs --by NAME" in capsys.readouterr().err
    assert _run("prune", "--apply", "--by", "Dr B", state=state) == 0
    assert _run("verify", state=state) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("intact: 7 events")
    assert b"Dr A" not in (state / _FILE).read_bytes(), "not in a free page either"


def test_nothing_is_pruned_while_a_gateway_runs(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with sole_gateway(sqlite_url(state)):
        assert _run("prune", "--apply", "--by", "Dr B", state=state) == 2
    assert "is held by another gateway that runs now" in capsys.readouterr().err


def test_an_index_of_images_that_is_none_is_one_sentence(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = record_of(open_database(sqlite_url(state)))
    fill(record)
    put_image(record, state / "images", "case-1", b"an image")
    record.append(EventDraft(StepRecorded(Step.ABANDONED, (), True, ""), "case-1", "Dr A"))
    record.close()
    (state / "images" / "index.sqlite").write_bytes(b"no database at all" * 100)
    assert _run("prune", "--apply", "--by", "Dr B", state=state) == 2
    said = capsys.readouterr().err
    assert "which cannot be written: file is not a database; end imaging" in said
    assert len(_sentences(said)) == 1
    assert _run("verify", state=state) == 0


def _sentences(said: str) -> list[str]:
    """Lines for people; where another test of this process has started a service, its log goes to stderr as well."""
    return [line for line in said.splitlines() if not line.startswith("{")]
