"""Backups: made while somebody writes, restored only where nothing is, ending with the same head."""

import contextlib
import multiprocessing
import os
import shutil
import sqlite3
import threading
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Engine, Row, insert, select, text

from services.ui_api.core.chain import ChainIntact
from services.ui_api.core.event_data import ImageReceived
from services.ui_api.core.events import EventDraft
from services.ui_api.record.backup import BackupManifest, back_up
from services.ui_api.record.database import existing_database, open_database, sqlite_url
from services.ui_api.record.images import stored_paths
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.restore import KeptIndex, require_record, restore
from services.ui_api.record.tables import PASSKEYS, USERS
from services.ui_api.record.unit_of_work import Answer
from services.ui_api.record.verify import verify_record
from shared.errors import InputError
from shared.parts.files import sha256_of
from tests.postgresql import Server
from tests.unit.services.ui_api.record.filled import STEP, fill, record_of

_AT = datetime(2026, 1, 2, tzinfo=UTC)
_IMAGE = b"a DICOM file"


def _filled(engine: Engine, images: Path) -> CaseRecord:
    record = record_of(engine)
    fill(record)
    sha256 = sha256_of(_IMAGE)
    record.append(EventDraft(ImageReceived(sha256, "1.2", 5, 1, None, "store", 1), "case-1", "imaging"))
    file = stored_paths(images, sha256)[0]
    file.parent.mkdir(parents=True)
    file.write_bytes(_IMAGE)
    return record


def _backed_up(engine: Engine, tmp_path: Path) -> BackupManifest:
    return back_up(engine, tmp_path / "images", tmp_path / "backup", _AT, "1")


@pytest.fixture
def other_url(record_url: str, tmp_path: Path, request: pytest.FixtureRequest) -> str:
    """An empty machine with the same kind of database."""
    if record_url.startswith("sqlite"):
        return sqlite_url(tmp_path / "other")
    server = request.getfixturevalue("postgresql")
    return str(server.url(server.make_database()))


def test_a_restored_record_ends_with_the_same_head(engine: Engine, other_url: str, tmp_path: Path) -> None:
    record = _filled(engine, tmp_path / "images")
    with record.write() as unit:
        unit.remember("key", "a" * 64, Answer(201, "{}", {}))
    made = _backed_up(engine, tmp_path)
    assert (made.events, made.images, made.is_complete) == (3, 1, True)
    chain = restore(tmp_path / "backup", other_url, tmp_path / "other" / "images").chain
    restored = open_database(other_url)
    assert chain == verify_record(restored) == ChainIntact(3, made.head_sha256)
    again = record_of(restored)
    assert again.ledger.cases == record.ledger.cases
    assert again.remembered("key") == record.remembered("key")
    assert stored_paths(tmp_path / "other" / "images", sha256_of(_IMAGE))[0].read_bytes() == _IMAGE
    again.append(STEP)
    restored.dispose()


def test_a_backup_is_of_one_moment_while_a_gateway_writes(engine: Engine, tmp_path: Path) -> None:
    record = _filled(engine, tmp_path / "images")
    ended = threading.Event()

    def write() -> None:
        while not ended.is_set():
            record.append(STEP)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        made = [back_up(engine, tmp_path / "images", tmp_path / f"backup-{n}", _AT, "1").events for n in range(3)]
    finally:
        ended.set()
        writer.join()
    assert made == sorted(made)
    assert isinstance(verify_record(engine), ChainIntact)
    assert record.ledger.head_sequence >= made[-1]


def test_a_record_moves_from_one_database_to_the_other(engine: Engine, tmp_path: Path) -> None:
    _filled(engine, tmp_path / "images")
    made = _backed_up(engine, tmp_path)
    url = sqlite_url(tmp_path / "moved")
    restore(tmp_path / "backup", url, tmp_path / "moved" / "images")
    assert verify_record(existing_database(url)) == ChainIntact(3, made.head_sha256)
    assert sorted(p.name for p in (tmp_path / "backup").iterdir()) == ["backup.json", "images", "record.sqlite"]


def test_nothing_is_restored_over_a_record(engine: Engine, record_url: str, tmp_path: Path) -> None:
    _filled(engine, tmp_path / "images")
    _backed_up(engine, tmp_path)
    with pytest.raises(InputError, match=r"there is a case record with 3 events at .*; restore onto an empty machine"):
        restore(tmp_path / "backup", record_url, tmp_path / "images")


def test_missing_and_damaged_images_are_named(engine: Engine, tmp_path: Path) -> None:
    record = _filled(engine, tmp_path / "images")
    record.append(EventDraft(ImageReceived("f" * 64, "1.3", 6, 1, None, "store", 2), "case-1", "imaging"))
    stored_paths(tmp_path / "images", sha256_of(_IMAGE))[0].write_bytes(b"cut")
    made = _backed_up(engine, tmp_path)
    assert (made.missing_images, made.damaged_images) == (("f" * 64,), (sha256_of(_IMAGE),))


def _put_passkey(record: CaseRecord) -> None:
    user = {"name": "dr.a", "roles_json": '["surgeon"]', "password_hash": "none", "disabled": False}
    passkey = {"id": "key", "user_name": "dr.a", "label": "phone", "public_credential": b"\x00\xff", "uses": 7}
    with record.write() as unit:
        unit.change(insert(USERS).values(**user, created_at_ns=1, provider_subject="issuer 1"))
        unit.change(insert(PASSKEYS).values(**passkey, created_at_ns=2))


def _accounts(engine: Engine) -> list[list[Row[Any]]]:
    with engine.connect() as connection:
        return [list(connection.execute(select(table))) for table in (USERS, PASSKEYS)]


@pytest.mark.parametrize("into", ["the same kind of database", "a file"])
def test_passkeys_come_along_with_their_accounts(engine: Engine, other_url: str, tmp_path: Path, into: str) -> None:
    _put_passkey(_filled(engine, tmp_path / "images"))
    _backed_up(engine, tmp_path)
    url = sqlite_url(tmp_path / "moved") if into == "a file" else other_url
    restore(tmp_path / "backup", url, tmp_path / "other" / "images")
    restored = open_database(url)
    assert _accounts(restored) == _accounts(engine)
    assert [len(rows) for rows in _accounts(restored)] == [1, 1]
    restored.dispose()


def test_passkeys_of_a_file_come_into_a_server(postgresql: Server, tmp_path: Path) -> None:
    engine = open_database(sqlite_url(tmp_path))
    _put_passkey(_filled(engine, tmp_path / "images"))
    _backed_up(engine, tmp_path)
    url = postgresql.url(postgresql.make_database())
    restore(tmp_path / "backup", url, tmp_path / "other" / "images")
    restored = open_database(url)
    assert [[tuple(row) for row in rows] for rows in _accounts(restored)] == _accounts(engine)
    for each in (engine, restored):
        each.dispose()


def _cut_the_end(folder: Path) -> None:
    engine = existing_database(f"sqlite:///{folder / 'record.sqlite'}")
    with engine.begin() as connection:
        connection.execute(text("DROP TRIGGER events_refuse_delete"))
        connection.execute(text("DELETE FROM events WHERE sequence = 3"))


def _change(folder: Path) -> None:
    engine = existing_database(f"sqlite:///{folder / 'record.sqlite'}")
    with engine.begin() as connection:
        connection.execute(text("DROP TRIGGER events_refuse_update"))
        connection.execute(text("UPDATE events SET who = 'nobody' WHERE sequence = 2"))


@pytest.mark.parametrize(
    ("damage", "finding"),
    [
        (lambda folder: (folder / "backup.json").unlink(), "is no whole backup: backup.json"),
        (lambda folder: (folder / "backup.json").write_text("{}"), "does not describe a backup"),
        (_cut_the_end, r"has 2 events and head [0-9a-f]{64}, backup.json names 3"),
        (_change, r"does not hold: event 2 \(step_recorded\) was changed"),
        (lambda folder: next(folder.rglob("*.dcm")).unlink(), "1 images, such as .*, are missing or damaged"),
        (lambda folder: next(folder.rglob("*.dcm")).write_bytes(b"x"), "1 images, such as .*, are missing or damaged"),
    ],
)
def test_a_damaged_backup_is_refused_and_leaves_nothing(
    tmp_path: Path, damage: Callable[[Path], object], finding: str
) -> None:
    engine = open_database(sqlite_url(tmp_path))
    _filled(engine, tmp_path / "images")
    _backed_up(engine, tmp_path)
    damage(tmp_path / "backup")
    url = sqlite_url(tmp_path / "other")
    with pytest.raises(InputError, match=finding):
        restore(tmp_path / "backup", url, tmp_path / "other" / "images")
    assert not (tmp_path / "other" / "case-record.sqlite").exists()


def test_a_backup_takes_an_empty_folder(tmp_path: Path) -> None:
    engine = open_database(sqlite_url(tmp_path))
    _filled(engine, tmp_path / "images")
    with pytest.raises(InputError, match="is not an empty folder; a backup needs one of its own"):
        back_up(engine, tmp_path / "images", tmp_path, _AT, "1")


@pytest.mark.parametrize("ending", ["-wal", "-shm", "-journal"])
@pytest.mark.parametrize("database", ["case-record.sqlite", "images/index.sqlite"])
def test_nothing_is_restored_beside_logs_of_another_database(tmp_path: Path, database: str, ending: str) -> None:
    engine = open_database(sqlite_url(tmp_path))
    _filled(engine, tmp_path / "images")
    _backed_up(engine, tmp_path)
    log = tmp_path / "other" / f"{database}{ending}"
    log.parent.mkdir(parents=True)
    log.write_bytes(b"of another one")
    name = Path(database).name
    with pytest.raises(InputError, match=f"has {name}{ending}, left behind by another {name}: .*; move {name}{ending}"):
        restore(tmp_path / "backup", sqlite_url(tmp_path / "other"), tmp_path / "other" / "images")
    assert not (tmp_path / "other" / "case-record.sqlite").exists()
    log.unlink()
    restore(tmp_path / "backup", sqlite_url(tmp_path / "other"), tmp_path / "other" / "images")


def _write_and_be_killed(state: Path, backup: Path) -> None:
    """A gateway whose process ends between two entries, after a backup and with entries in its log."""
    engine = open_database(sqlite_url(state))
    record = record_of(engine)
    fill(record)
    back_up(engine, state / "images", backup, _AT, "1")
    record.append(STEP)
    os._exit(9)


def test_the_log_of_a_killed_gateway_comes_into_no_restored_record(tmp_path: Path) -> None:
    state, backup = tmp_path / "state", tmp_path / "backup"
    killed = multiprocessing.get_context("spawn").Process(target=_write_and_be_killed, args=(state, backup))
    killed.start()
    killed.join()
    assert killed.exitcode == 9
    (state / "case-record.sqlite").unlink()
    logs = r"case-record\.sqlite-wal and case-record\.sqlite-shm"
    with pytest.raises(InputError, match=f"has {logs}, left behind by another .*; move {logs} away"):
        restore(backup, sqlite_url(state), state / "images")
    for log in state.glob("case-record.sqlite-*"):
        log.unlink()
    chain = restore(backup, sqlite_url(state), state / "images").chain
    assert (chain.entries, chain) == (2, verify_record(existing_database(sqlite_url(state))))


def test_a_file_that_is_no_record_is_named_with_what_to_do(tmp_path: Path) -> None:
    engine = open_database(sqlite_url(tmp_path))
    _filled(engine, tmp_path / "images")
    _backed_up(engine, tmp_path)
    file = tmp_path / "other" / "case-record.sqlite"
    file.parent.mkdir()
    file.write_bytes(b"no database at all" * 100)
    (tmp_path / "other" / "case-record.sqlite-journal").write_bytes(b"")
    with pytest.raises(InputError, match=r"no readable case record \(file is not a database\) .* move case-record"):
        restore(tmp_path / "backup", sqlite_url(tmp_path / "other"), tmp_path / "other" / "images")


def test_a_record_that_is_another_one_once_it_lies_there_is_refused(engine: Engine, record_url: str) -> None:
    fill(record_of(engine))
    found = verify_record(engine)
    assert isinstance(found, ChainIntact)
    require_record(record_url, found)
    with pytest.raises(InputError, match=r"not the one that was backed up \(expected .*entries=3.* found .*entries=2"):
        require_record(record_url, ChainIntact(3, found.head_sha256))


def test_a_record_that_cannot_be_read_once_it_lies_there_is_refused(tmp_path: Path) -> None:
    (tmp_path / "case-record.sqlite").write_bytes(b"no database at all" * 100)
    with pytest.raises(InputError, match="found file is not a database"):
        require_record(sqlite_url(tmp_path), ChainIntact(1, "a" * 64))


def test_documents_that_a_server_changes_while_they_are_restored_are_found(postgresql: Server, tmp_path: Path) -> None:
    engine = open_database(sqlite_url(tmp_path))
    _filled(engine, tmp_path / "images")
    _backed_up(engine, tmp_path)
    url = postgresql.url(postgresql.make_database())
    target = open_database(url)
    with target.begin() as connection:
        connection.execute(
            text(
                "CREATE FUNCTION blank() RETURNS trigger LANGUAGE plpgsql AS "
                "$$ BEGIN NEW.content = ''; RETURN NEW; END $$; "
                "CREATE TRIGGER blank BEFORE INSERT ON documents FOR EACH ROW EXECUTE FUNCTION blank()"
            )
        )
    target.dispose()
    with pytest.raises(InputError, match=r"not the one that was backed up .* found ChainBroken.*was changed"):
        restore(tmp_path / "backup", url, tmp_path / "other" / "images")


def _index(folder: Path, *images: str, store: str = "store") -> Path:
    """An index as imaging writes it: images by their numbers from 1."""
    file = folder / "index.sqlite"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.unlink(missing_ok=True)
    with contextlib.closing(sqlite3.connect(file, isolation_level=None)) as index:
        index.execute("PRAGMA journal_mode = WAL")
        index.execute("CREATE TABLE store (id TEXT NOT NULL)")
        index.execute("CREATE TABLE images (sequence INTEGER PRIMARY KEY, sha256 TEXT NOT NULL)")
        index.execute("INSERT INTO store VALUES (?)", (store,))
        index.executemany("INSERT INTO images VALUES (?, ?)", enumerate(images, 1))
    return file


def _numbered(file: Path) -> list[str]:
    with contextlib.closing(sqlite3.connect(file)) as index:
        return [row[0] for row in index.execute("SELECT sha256 FROM images ORDER BY sequence")]


@pytest.fixture
def backup_of_two(tmp_path: Path) -> Path:
    """A backup whose index of images ends with number 2."""
    engine = open_database(sqlite_url(tmp_path))
    _filled(engine, tmp_path / "images")
    _index(tmp_path / "images", "a", "b")
    _backed_up(engine, tmp_path)
    return tmp_path / "backup"


@pytest.mark.parametrize(
    ("there", "kept", "after"),
    [
        ("abcd", KeptIndex(4, 2), "abcd"),
        ("ab", KeptIndex(2, 2), "ab"),
        ("a", None, "ab"),
        ("", None, "ab"),
    ],
)
def test_numbers_of_images_never_go_back(
    backup_of_two: Path, tmp_path: Path, there: str, kept: KeptIndex | None, after: str
) -> None:
    file = _index(tmp_path / "other" / "images", *there)
    restored = restore(backup_of_two, sqlite_url(tmp_path / "other"), file.parent)
    assert (restored.kept_index, _numbered(file)) == (kept, list(after))


def test_an_index_that_imaging_left_with_its_log_is_kept_with_it(backup_of_two: Path, tmp_path: Path) -> None:
    file = _index(tmp_path / "other" / "images", *"ab")
    with contextlib.closing(sqlite3.connect(file, isolation_level=None)) as imaging:
        imaging.execute("INSERT INTO images VALUES (3, 'c')")
        for ending in ("", "-wal"):
            shutil.copy(f"{file}{ending}", f"{tmp_path}/killed{ending}")
    for ending in ("", "-wal"):
        shutil.copy(f"{tmp_path}/killed{ending}", f"{file}{ending}")
    restored = restore(backup_of_two, sqlite_url(tmp_path / "other"), file.parent)
    assert (restored.kept_index, _numbered(file)) == (KeptIndex(3, 2), list("abc"))


def test_an_index_is_not_replaced_while_imaging_uses_it(backup_of_two: Path, tmp_path: Path) -> None:
    file = _index(tmp_path / "other" / "images", "a")
    with contextlib.closing(sqlite3.connect(file)) as imaging:
        imaging.execute("SELECT * FROM images").fetchall()
        with pytest.raises(InputError, match="is in use, and ends with number 1 of 2; end imaging"):
            restore(backup_of_two, sqlite_url(tmp_path / "other"), file.parent)


@pytest.mark.parametrize(
    ("images", "store", "finding"),
    [
        ("axc", "store", "index give number 2 to different images; restore onto an empty machine"),
        ("x", "store", "index give number 1 to different images"),
        ("abc", "another", "numbers the images of another installation"),
    ],
)
def test_an_index_of_other_images_is_refused(
    backup_of_two: Path, tmp_path: Path, images: str, store: str, finding: str
) -> None:
    file = _index(tmp_path / "other" / "images", *images, store=store)
    with pytest.raises(InputError, match=finding):
        restore(backup_of_two, sqlite_url(tmp_path / "other"), file.parent)
    assert _numbered(file) == list(images)


def test_an_index_beside_a_backup_without_one_is_refused(engine: Engine, tmp_path: Path) -> None:
    _filled(engine, tmp_path / "images")
    _backed_up(engine, tmp_path)
    file = _index(tmp_path / "other" / "images", "a")
    with pytest.raises(InputError, match="numbers images, and the backup has no index to compare it with"):
        restore(tmp_path / "backup", sqlite_url(tmp_path / "other"), file.parent)


def test_a_damaged_image_that_lies_there_is_replaced(engine: Engine, tmp_path: Path) -> None:
    _filled(engine, tmp_path / "images")
    _backed_up(engine, tmp_path)
    there = tmp_path / "other" / "images"
    damaged = stored_paths(there, sha256_of(_IMAGE))[0]
    damaged.parent.mkdir(parents=True)
    damaged.write_bytes(b"cut")
    restore(tmp_path / "backup", sqlite_url(tmp_path / "other"), there)
    assert damaged.read_bytes() == _IMAGE


def test_a_folder_may_have_any_name(backup_of_two: Path, tmp_path: Path) -> None:
    file = _index(tmp_path / "a room? #1 50%20" / "images", *"abc")
    restored = restore(backup_of_two, sqlite_url(tmp_path / "other"), file.parent)
    assert restored.kept_index == KeptIndex(3, 2)


def test_what_a_killed_restore_left_is_removed_by_the_next(
    backup_of_two: Path, other_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = tmp_path

    def killed(folder: Path, file: Path) -> None:
        nonlocal left
        left = file.parent
        shutil.copytree(left, left.with_name(f"{left.name}-kept"))
        raise InputError("killed")

    monkeypatch.setattr("services.ui_api.record.restore.copy_sqlite", killed)
    with pytest.raises(InputError, match="killed"):
        restore(backup_of_two, other_url, tmp_path / "other" / "images")
    assert len(list(left.parent.glob(".restoring-*"))) == 1
    monkeypatch.undo()
    restore(backup_of_two, other_url, tmp_path / "other" / "images")
    assert not list(left.parent.glob(".restoring-*"))
