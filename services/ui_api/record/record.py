"""The case record: one writer, many readers, and a ledger that is always what the log adds up to."""

import json
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Final

from sqlalchemy import Connection, Engine, RowMapping, Select, bindparam, delete, func, insert, select
from sqlalchemy.exc import DBAPIError, IntegrityError, OperationalError, ProgrammingError
from sqlalchemy.exc import TimeoutError as PoolTimeout

from services.ui_api.core.chain import GENESIS_SHA256, ChainEntry, why_broken
from services.ui_api.core.event_data import ImageReceived
from services.ui_api.core.events import Event, EventDraft, EventKind
from services.ui_api.core.ledger import Ledger
from services.ui_api.core.pruning import PrunedEntries
from services.ui_api.record.codec import decoded, entry_of_row
from services.ui_api.record.engines import BUSY_MS, WRITES, cause_of, unpooled
from services.ui_api.record.tables import ANSWERS, DOCUMENTS, EVENTS, PROBE
from services.ui_api.record.unit_of_work import Answer, RememberedAnswer, UnitOfWork
from shared.errors import ConfigurationError, DistalockError, InputError, RecordUnavailable
from shared.threads import described, report_error

# Chosen: events read in one go; bounds the memory, and the time for which the database is held.
PAGE = 500
# A client repeats a request within seconds; a day leaves room for one that was switched off over night.
ANSWERS_LAST_NS: Final = 24 * 3600 * 10**9
_PROBE_BUSY_MS: Final = 1000
# Made once: see `unit_of_work`.
_READ_DOCUMENT: Final = select(DOCUMENTS.c.content).where(DOCUMENTS.c.sha256 == bindparam("named"))
_READ_ANSWER: Final = select(ANSWERS).where(ANSWERS.c.idempotency_key == bindparam("named"))


class CaseRecord:
    """Opens on an upgraded database and folds its whole log.

    Parameters
    ----------
    engine
        From `record.database.open_database`.
    clock_ns
        Wall clock, nanoseconds since 1970: for people, and for the age of stored answers.
    images_held
        How many images of each case the ledger holds at least; None: all. The log holds all.

    Attributes
    ----------
    on_write
        Called with the seconds that a unit of work took, from the wait for its turn until it was on the disk.

    Raises
    ------
    ConfigurationError
        When the log cannot be read to its end.
    """

    def __init__(self, engine: Engine, clock_ns: Callable[[], int], images_held: int | None = None) -> None:
        self._engine = engine
        self._fresh = unpooled(engine)
        self._clock_ns = clock_ns
        self._writer = threading.RLock()
        self._listeners: list[Callable[[Sequence[Event]], None]] = []
        self._head_sha256 = GENESIS_SHA256
        self._in_doubt = False
        self.on_write: Callable[[float], None] = lambda _: None
        self.ledger = Ledger(images_held)
        self._fold_log()
        self._file = _File(engine)

    def listen(self, listener: Callable[[Sequence[Event]], None]) -> None:
        """Call with every batch of new events, after they are on the disk and in the ledger."""
        self._listeners.append(listener)

    @contextmanager
    def write(self) -> Iterator[UnitOfWork]:
        """One transaction. Within it the ledger does not change: decide, then append.

        An event that does not fit what is known raises before anything is written: the log can always be read again.
        Functions given to `UnitOfWork.after_commit` run once the transaction is on the disk, in the order of the log;
        what they raise is reported as an error, for what was written stays written.

        Raises
        ------
        RecordUnavailable
            When the database cannot be written now: it is locked, full, read-only, damaged or gone. Nothing was
            written, unless it went while it confirmed: the next unit of work takes in what is there.
        """
        began_s = time.monotonic()
        with self._writer:
            with self._transaction(self._engine) as connection:
                if self._in_doubt:
                    self._take_in_what_was_committed(connection)
                unit = UnitOfWork(connection, self.ledger.head_sequence, self._head_sha256, self._clock_ns())
                yield unit
                after = self.ledger.with_events(unit.events)
                self._in_doubt = True
            self.on_write(time.monotonic() - began_s)
            self._in_doubt = False
            self._head_sha256 = unit.head_sha256
            self.ledger.become(after)
            self._tell(unit.events)
            for effect in unit.afterwards:
                _carried_out(effect)

    def _take_in_what_was_committed(self, connection: Connection) -> None:
        """A commit was not confirmed, so nobody knew until now whether it reached the disk."""
        newer = select(EVENTS).where(EVENTS.c.sequence > self.ledger.head_sequence).order_by(EVENTS.c.sequence)
        events = [self._taken(entry_of_row(row)) for row in connection.execute(newer)]
        self._in_doubt = False
        self._tell([event for event in events if event is not None])

    def _tell(self, events: Sequence[Event]) -> None:
        for listener in self._listeners if events else ():
            _carried_out(partial(listener, events))

    @contextmanager
    def _transaction(self, engine: Engine, **options: int) -> Iterator[Connection]:
        with (
            _unavailable("written"),
            engine.connect().execution_options(**{WRITES: True}, **options) as connection,
            _given_up_when_it_fails(connection),
            connection.begin(),
        ):
            yield connection

    @contextmanager
    def _reading(self) -> Iterator[Connection]:
        with _unavailable("read"), self._engine.connect() as connection:
            yield connection

    def append(self, *drafts: EventDraft) -> None:
        """Append events in a transaction of their own."""
        with self.write() as unit:
            for draft in drafts:
                unit.append(draft)

    def events_after(self, sequence: int, case_id: str | None = None, limit: int = PAGE) -> list[Event]:
        """Events after a sequence number, the oldest first; of one case or of all."""
        is_there = EVENTS.c.data_json != ""  # what was pruned has no content to read
        query = select(EVENTS).where(EVENTS.c.sequence > sequence, is_there).order_by(EVENTS.c.sequence).limit(limit)
        if case_id is not None:
            query = query.where(EVENTS.c.case_id == case_id)
        with self._reading() as connection:
            return [decoded(entry_of_row(row)) for row in connection.execute(query)]

    def image_let_go(self, case_id: str, sha256: str) -> ImageReceived | None:
        """An image of a case that the ledger no longer holds: the newest of that hash on record."""
        names_it = EVENTS.c.data_json.contains(sha256, autoescape=True)
        of_kind = EVENTS.c.kind == EventKind.IMAGE_RECEIVED
        query = select(EVENTS).where(EVENTS.c.case_id == case_id, of_kind, names_it).order_by(EVENTS.c.sequence.desc())
        with self._reading() as connection:
            found = (decoded(entry_of_row(row)).data for row in connection.execute(query))
            return next((i for i in found if isinstance(i, ImageReceived) and i.image_sha256 == sha256), None)

    def document(self, sha256: str) -> bytes:
        """A document's content; raises `KeyError` when there is none of that hash."""
        with self._reading() as connection:
            row = connection.execute(_READ_DOCUMENT, {"named": sha256}).first()
        if row is None:
            raise KeyError(sha256)
        return bytes(row[0])

    def remembered(self, key: str) -> RememberedAnswer | None:
        """The answer that was given under an idempotency key, if any."""
        with self._reading() as connection:
            row = connection.execute(_READ_ANSWER, {"named": key}).mappings().first()
        if row is None:
            return None
        answer = Answer(row["status"], row["body_json"], json.loads(row["headers_json"]))
        return RememberedAnswer(row["request_sha256"], answer)

    def rows(self, query: Select[tuple[str | int | bool, ...]]) -> Sequence[RowMapping]:
        """What tables beside the log hold, such as those of accounts."""
        with self._reading() as connection:
            return connection.execute(query).mappings().all()

    def forget_old_answers(self) -> None:
        """Delete what was answered under idempotency keys so long ago that nobody repeats it any more."""
        with self._transaction(self._engine) as connection:
            connection.execute(delete(ANSWERS).where(ANSWERS.c.answered_at_ns < self._clock_ns() - ANSWERS_LAST_NS))

    def require_writable(self) -> None:
        """Write a row of no meaning in place of the last one, and find the newest event where it was written.

        Raises
        ------
        RecordUnavailable
            When the database cannot be written now, or is not the one that was opened.
        """
        with self._transaction(self._fresh, **{BUSY_MS: _PROBE_BUSY_MS}) as connection:
            connection.execute(delete(PROBE))
            connection.execute(insert(PROBE).values(id=1, at_ns=self._clock_ns()))
            newest = connection.execute(select(func.max(EVENTS.c.sequence))).scalar() or 0
        if newest < self.ledger.head_sequence or not self._file.is_same():
            raise RecordUnavailable(
                f"the case record's newest event is {newest}, not {self.ledger.head_sequence}, or its file was "
                "replaced; end the gateway, and restore the record from a backup"
            )

    @property
    def folder(self) -> Path | None:
        """Where the database's file lies; None of a database that is no file."""
        return None if self._file.path is None else self._file.path.parent

    def close(self) -> None:
        """Close all connections, once the write under way is done."""
        with self._writer:
            self._engine.dispose()

    def _fold_log(self) -> None:
        """Read and check the whole log; raises `ConfigurationError` with one sentence when it is damaged."""
        pruned = PrunedEntries()
        try:
            with self._engine.connect() as connection:
                for row in connection.execute(select(EVENTS).order_by(EVENTS.c.sequence)):
                    entry = entry_of_row(row)
                    self._taken(entry)
                    pruned.see(entry.sequence, entry.case_id, entry.kind, entry.data_json)
            if (number := pruned.unannounced()) is not None:
                raise InputError(f"event {number} is empty, and no later event tells that it was pruned")
        except (DBAPIError, DistalockError, ValueError, KeyError, TypeError) as error:
            cause = cause_of(error) if isinstance(error, DBAPIError) else _in_one_line(error)
            raise ConfigurationError(
                f"the case record is damaged after event {self.ledger.head_sequence} ({cause}); "
                "restore it from a backup, or set another state_dir"
            ) from error

    def _taken(self, entry: ChainEntry) -> Event | None:
        """Fold in the next entry of the log; None when its content was pruned."""
        if (why := why_broken(entry, self.ledger.head_sequence + 1, self._head_sha256)) is not None:
            raise InputError(why)
        event = None if entry.is_pruned else decoded(entry)
        if event is None:
            self.ledger.pass_over(entry.sequence)
        else:
            self.ledger.take(event)
        self._head_sha256 = entry.sha256
        return event


@contextmanager
def _unavailable(done: str) -> Iterator[None]:
    """What the database cannot do now, in one sentence; a statement that is wrong is a fault of this program."""
    try:
        yield
    except (IntegrityError, ProgrammingError):
        raise
    except (DBAPIError, PoolTimeout, sqlite3.Error, UnicodeDecodeError) as error:
        raise RecordUnavailable(
            f"the case record cannot be {done} now ({cause_of(error)}); see to its disk, and who else holds it"
        ) from error


@contextmanager
def _given_up_when_it_fails(connection: Connection) -> Iterator[None]:
    """The next transaction gets a new connection: SQLite opens a file for reading alone when memory or handles lack."""
    try:
        yield
    except OperationalError:
        connection.invalidate()
        raise


def _in_one_line(error: Exception) -> str:
    return str(error) if isinstance(error, DistalockError) else described(error)


def _carried_out(effect: Callable[[], None]) -> None:
    try:
        effect()
    except Exception as error:  # noqa: BLE001 - what was written stays written, and the other effects are due
        report_error("what was to be done after an entry in the record", error)


class _File:
    """The database's file as it was when it was opened: one that is deleted or replaced takes no more entries."""

    def __init__(self, engine: Engine) -> None:
        file = engine.url.database if engine.url.get_backend_name() == "sqlite" else None
        self.path = None if not file or file == ":memory:" else Path(file)
        self._inode = self._found()

    def is_same(self) -> bool:
        """Whether it is still there; always true of a database that is no file."""
        return self._found() == self._inode

    def _found(self) -> int | None:
        try:
            return None if self.path is None else self.path.stat().st_ino
        except OSError:
            return -1
