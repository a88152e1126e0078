"""The case record, on SQLite and on PostgreSQL: the same tests."""

import random
import re
import sqlite3
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import Engine, text
from sqlalchemy import event as sqlalchemy_event
from sqlalchemy.exc import IntegrityError

from services.ui_api.core.chain import ChainBroken, ChainIntact
from services.ui_api.core.event_data import CaseOpened, ImageReceived
from services.ui_api.core.events import Event, EventDraft, EventKind
from services.ui_api.core.robot_event_data import OperationEnded, OperationStatus
from services.ui_api.record.database import existing_database, open_database, sole_gateway, sqlite_url
from services.ui_api.record.engines import WRITES, is_sqlite
from services.ui_api.record.record import ANSWERS_LAST_NS, CaseRecord
from services.ui_api.record.tables import METADATA
from services.ui_api.record.unit_of_work import Answer
from services.ui_api.record.verify import verify_record
from shared.errors import ConfigurationError, RecordUnavailable
from tests.postgresql import Server
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.record.filled import STEP, fill, record_of

_OPENED = EventDraft(CaseOpened(samples.case_setup()), "case-1", "Dr A")


def _tamper(engine: Engine, statement: str) -> None:
    """Change the database as someone would who also removes the triggers."""
    with engine.begin() as connection:
        for table in ("events", "documents"):
            for verb in ("update", "delete"):
                on = "" if is_sqlite(engine) else f" ON {table}"
                connection.execute(text(f"DROP TRIGGER {table}_refuse_{verb}{on}"))
        connection.execute(text(statement), {"zero": b"\0"} if ":zero" in statement else {})


def test_a_reopened_record_adds_up_to_the_same(engine: Engine) -> None:
    record = record_of(engine)
    record.append(_OPENED, STEP)
    again = record_of(engine)
    assert again.ledger.cases == record.ledger.cases
    assert again.ledger.cases["case-1"].drilled_hole_ids == {"distal"}
    assert [e.kind for e in again.events_after(0)] == [EventKind.CASE_OPENED, EventKind.STEP_RECORDED]
    again.append(STEP)
    assert again.ledger.head_sequence == 3


def test_a_frame_that_the_ledger_let_go_is_found_on_record(engine: Engine) -> None:
    record = CaseRecord(engine, lambda: 1, images_held=4)
    record.append(_OPENED)
    frames = [ImageReceived(samples.sha(f"{n}"), "1.2", 1, 1, None, "store", n, in_run=True) for n in range(1, 21)]
    for frame in frames:
        record.append(EventDraft(frame, "case-1", "imaging"))
    case = record.ledger.cases["case-1"]
    assert case.image(frames[0].image_sha256) is None
    assert record.image_let_go("case-1", frames[0].image_sha256) == frames[0]
    assert record.image_let_go("case-1", samples.sha("another")) is None


def test_what_fails_half_way_leaves_nothing(engine: Engine) -> None:
    record = record_of(engine)
    told: list[Event] = []
    record.listen(told.extend)

    def half() -> None:
        with record.write() as unit:
            unit.append(_OPENED)
            unit.put_document(b"{}")
            unit.after_commit(lambda: pytest.fail("it was not committed"))
            raise RuntimeError("half-way")

    with pytest.raises(RuntimeError, match="half-way"):
        half()
    assert (record.events_after(0), told, record.ledger.head_sequence) == ([], [], 0)
    with pytest.raises(KeyError):
        record.document(samples.sha("{}"))
    record.append(_OPENED)
    assert [e.sequence for e in told] == [1]


def test_events_are_read_by_case_and_from_a_place(engine: Engine) -> None:
    record = record_of(engine)
    record.append(_OPENED, EventDraft(CaseOpened(samples.case_setup()), "case-2", "Dr B"), STEP)
    assert [e.sequence for e in record.events_after(0, "case-1")] == [1, 3]
    assert [e.sequence for e in record.events_after(1)] == [2, 3]
    assert [e.sequence for e in record.events_after(0, limit=2)] == [1, 2]


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE events SET who = 'x'",
        "UPDATE events SET who = '', why = '', data_json = ''",
        "DELETE FROM events",
        "DELETE FROM documents",
        "UPDATE documents SET media_type = 'x'",
        "INSERT INTO events SELECT * FROM events",
        "INSERT INTO prunings VALUES ('case-1', 1)",
        "INSERT INTO documents_to_prune SELECT sha256, 1 FROM documents",
    ],
)
def test_the_database_itself_refuses_changes(engine: Engine, statement: str) -> None:
    record = record_of(engine)
    with record.write() as unit:
        unit.append(_OPENED)
        unit.put_document(b"{}")
    with pytest.raises(IntegrityError, match=r"are append-only|unique"), engine.begin() as connection:
        connection.execute(text(statement))
    assert len(record.events_after(0)) == 1


def test_sqlites_way_round_a_refused_deletion_is_refused(tmp_path: Path) -> None:
    engine = open_database(sqlite_url(tmp_path))
    record_of(engine).append(_OPENED)
    replacing = (
        "INSERT OR REPLACE INTO events SELECT sequence, 0, case_id, 'x', why, kind, data_json, previous_sha256, sha256"
    )
    with pytest.raises(IntegrityError, match="events are append-only"), engine.begin() as connection:
        connection.execute(text(f"{replacing} FROM events"))


def test_postgresqls_way_round_a_refused_deletion_is_refused(postgresql: Server, migrated: str) -> None:
    engine = open_database(postgresql.url(postgresql.make_database(migrated)))
    record_of(engine).append(_OPENED)
    with pytest.raises(IntegrityError, match="events are append-only"), engine.begin() as connection:
        connection.execute(text("TRUNCATE events CASCADE"))
    engine.dispose()


@pytest.mark.requirement("GW-06")
@pytest.mark.parametrize(
    ("statement", "finding"),
    [
        ("UPDATE events SET who = 'Dr B' WHERE sequence = 1", r"event 1 \(case_opened\) was changed"),
        ("DELETE FROM events WHERE sequence = 1", "event 1 is missing"),
        ("UPDATE documents SET content = 'forged'", r"document [0-9a-f]{64}, which event 1 .* names, was changed"),
        ("UPDATE documents SET content = :zero", r"document [0-9a-f]{64}, which event 1 .* names, was changed"),
        ("DELETE FROM documents", r"document [0-9a-f]{64}, which event 1 .* names, is missing"),
    ],
)
def test_verify_finds_what_was_tampered_with(engine: Engine, statement: str, finding: str) -> None:
    fill(record_of(engine))
    assert isinstance(verify_record(engine), ChainIntact)
    _tamper(engine, statement)
    verdict = verify_record(engine)
    assert isinstance(verdict, ChainBroken)
    assert re.search(finding, verdict.message)


def test_a_document_is_stored_once(engine: Engine) -> None:
    record = record_of(engine)
    for _ in range(2):
        with record.write() as unit:
            sha256 = unit.put_document(b"[1]")
    assert record.document(sha256) == b"[1]"


def test_answers_are_remembered_by_their_key(engine: Engine) -> None:
    record = record_of(engine)
    answer = Answer(201, "{}", {"location": "/x"})
    with record.write() as unit:
        unit.remember("key", "a" * 64, answer)
    known = record_of(engine).remembered("key")
    assert known is not None
    assert (known.request_sha256, known.answer) == ("a" * 64, answer)
    assert record.remembered("other") is None


def test_commits_reach_the_disk_before_they_are_acknowledged(engine: Engine) -> None:
    with engine.connect() as connection:
        if not is_sqlite(engine):
            assert connection.execute(text("SHOW synchronous_commit")).scalar() == "on"
            return
        assert connection.execute(text("PRAGMA journal_mode")).scalar() == "wal"
        assert connection.execute(text("PRAGMA synchronous")).scalar() == 2, "FULL"


def test_the_migrations_make_the_tables_that_the_code_expects(engine: Engine) -> None:
    with engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), METADATA) == []


def test_a_record_of_a_newer_version_is_refused(engine: Engine, record_url: str) -> None:
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(ConfigurationError, match=r"not one that this version knows .*9999.*start the newer version"):
        open_database(record_url)


def test_a_password_is_not_shown() -> None:
    with pytest.raises(
        ConfigurationError, match=r"case record postgresql://distalock:\*\*\*@127\.0\.0\.1:1/x: cannot be"
    ):
        open_database("postgresql://distalock:secret@127.0.0.1:1/x")


def test_another_kind_of_database_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="mysql is not supported; use sqlite or postgresql"):
        open_database("mysql://localhost/x")


def test_a_second_gateway_is_refused(record_url: str) -> None:
    with sole_gateway(record_url), pytest.raises(ConfigurationError, match="is held by another gateway"):  # noqa: SIM117
        with sole_gateway(record_url):
            pytest.fail("it was let in")
    with sole_gateway(record_url):
        pass


def test_a_file_that_is_no_database_is_refused(tmp_path: Path) -> None:
    (tmp_path / "case-record.sqlite").write_bytes(b"this is not a database, it is a sentence" * 100)
    with pytest.raises(ConfigurationError, match="cannot be opened: file is not a database"):
        open_database(sqlite_url(tmp_path))


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match="its folder cannot be made"):
        open_database(sqlite_url(tmp_path / "file"))


def test_a_url_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="database URL 'nonsense' cannot be used"):
        open_database("nonsense")


def test_there_is_nothing_to_read_where_no_record_is(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="there is no case record at"):
        existing_database(sqlite_url(tmp_path))
    assert list(tmp_path.iterdir()) == []


def test_an_event_that_does_not_fit_is_refused_before_it_is_written(engine: Engine) -> None:
    record = record_of(engine)
    record.append(_OPENED)
    ended = OperationEnded("never begun", OperationStatus.SUCCEEDED, began=True, code="", message="")
    with pytest.raises(KeyError):
        record.append(STEP, EventDraft(ended, None, "robot"))
    assert (len(record.events_after(0)), record.ledger.head_sequence) == (1, 1)
    assert record_of(engine).ledger.cases == record.ledger.cases
    record.append(STEP)
    assert record.ledger.head_sequence == 2


def test_what_follows_an_entry_is_done_in_the_order_of_the_log(engine: Engine) -> None:
    record = record_of(engine)
    done: list[str] = []
    second = threading.Thread(target=lambda: _write_with_effect(record, lambda: done.append("second")))

    def first() -> None:
        second.start()  # has to wait: the order of the log is the order of what follows
        second.join(0.1)
        done.append("first")

    _write_with_effect(record, first)
    second.join(PATIENCE_S)
    assert done == ["first", "second"]


def test_what_fails_after_an_entry_neither_undoes_it_nor_hinders_the_rest(engine: Engine) -> None:
    record = record_of(engine)
    done: list[str] = []
    record.listen(lambda _: 1 / 0)  # type: ignore[arg-type]
    with record.write() as unit:
        unit.append(_OPENED)
        unit.after_commit(lambda: 1 / 0)  # type: ignore[arg-type]
        unit.after_commit(lambda: done.append("done"))
    assert done == ["done"]
    assert record.ledger.head_sequence == 1


def test_answers_are_forgotten_after_a_day(engine: Engine) -> None:
    now_ns = 10**18
    record = CaseRecord(engine, lambda: now_ns)
    with record.write() as unit:
        unit.remember("key", "a" * 64, Answer(201, "{}", {}))
    now_ns += ANSWERS_LAST_NS
    record.forget_old_answers()
    assert record.remembered("key") is not None
    now_ns += 1
    record.forget_old_answers()
    assert record.remembered("key") is None


def test_a_locked_record_is_unavailable(engine: Engine) -> None:
    record = record_of(engine)
    with engine.connect().execution_options(**{WRITES: True}) as holder:
        if not is_sqlite(engine):
            holder.execute(text("LOCK TABLE probe"))
        else:
            holder.execute(text("SELECT 1"))
        with pytest.raises(RecordUnavailable, match=r"cannot be written now \((database is locked|.*lock timeout)"):
            record.require_writable()
    record.require_writable()


def test_a_changed_log_is_one_sentence(engine: Engine) -> None:
    record_of(engine).append(_OPENED, STEP)
    _tamper(engine, "UPDATE events SET who = 'nobody' WHERE sequence = 2")
    expected = r"the case record is damaged after event 1 \(event 2 \(step_recorded\) was changed: .*\); restore it"
    with pytest.raises(ConfigurationError, match=expected):
        record_of(engine)


@pytest.mark.parametrize("seed", range(24))
def test_a_damaged_file_is_refused_or_reported_in_one_sentence(tmp_path: Path, seed: int) -> None:
    record = record_of(open_database(sqlite_url(tmp_path)))
    fill(record)
    record.append(*[STEP] * 20)
    record.close()
    _damage(tmp_path / "case-record.sqlite", random.Random(seed))
    said = ""
    try:
        damaged = record_of(open_database(sqlite_url(tmp_path)))
        damaged.require_writable()
        damaged.events_after(0)
    except (ConfigurationError, RecordUnavailable) as error:
        said = str(error)
    assert "\n" not in said


def _damage(file: Path, rng: random.Random) -> None:
    content = bytearray(file.read_bytes())
    page = 4096 * rng.randrange(len(content) // 4096)
    match rng.randrange(4):
        case 0:
            for _ in range(rng.randint(1, 200)):
                content[rng.randrange(len(content))] = rng.randrange(256)
        case 1:
            content[page : page + 4096] = rng.randbytes(4096)
        case 2:
            content[page : page + 4096] = bytes(4096)
        case _:
            del content[rng.randrange(len(content)) :]
    file.write_bytes(content)


def _write_with_effect(record: CaseRecord, effect: Callable[[], None]) -> None:
    with record.write() as unit:
        unit.after_commit(effect)


def test_a_connection_that_was_opened_for_reading_alone_is_not_used_again(tmp_path: Path) -> None:
    """As SQLite does while the process may have no memory or handle more."""
    engine = open_database(sqlite_url(tmp_path))
    record = record_of(engine)
    engine.dispose()

    @sqlalchemy_event.listens_for(engine, "connect", once=True)
    def for_reading_alone(connection: sqlite3.Connection, _: object) -> None:
        connection.execute("PRAGMA query_only=ON")

    with pytest.raises(RecordUnavailable, match="attempt to write a readonly database"):
        record.append(STEP)
    record.append(STEP)
    assert record.ledger.head_sequence == 1
    record.close()
