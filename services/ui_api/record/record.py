"""The case record: one writer, many readers, and a ledger that is always what the log adds up to."""

import json
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from sqlalchemy import Engine, select

from services.ui_api.core.chain import GENESIS_SHA256
from services.ui_api.core.events import Event, EventDraft
from services.ui_api.core.ledger import Ledger
from services.ui_api.record.codec import decoded, entry_of_row
from services.ui_api.record.database import WRITES
from services.ui_api.record.tables import ANSWERS, DOCUMENTS, EVENTS
from services.ui_api.record.unit_of_work import Answer, RememberedAnswer, UnitOfWork

PAGE = 500


class CaseRecord:
    """Opens on an upgraded database and folds its whole log.

    Parameters
    ----------
    engine
        From `record.database.open_database`.
    clock_ns
        Wall clock, nanoseconds since 1970: for people, never compared.
    """

    def __init__(self, engine: Engine, clock_ns: Callable[[], int]) -> None:
        self._engine = engine
        self._clock_ns = clock_ns
        self._writer = threading.RLock()
        self._listeners: list[Callable[[Sequence[Event]], None]] = []
        self._head_sha256 = GENESIS_SHA256
        self.ledger = Ledger()
        self._fold_log()

    def listen(self, listener: Callable[[Sequence[Event]], None]) -> None:
        """Call with every batch of new events, after they are on the disk and in the ledger."""
        self._listeners.append(listener)

    @contextmanager
    def write(self) -> Iterator[UnitOfWork]:
        """One transaction. Within it the ledger does not change: decide, then append.

        Functions given to `UnitOfWork.after_commit` run once the transaction is on the disk and the lock is released.
        """
        with self._writer:
            with self._engine.connect().execution_options(**{WRITES: True}) as connection, connection.begin():
                unit = UnitOfWork(connection, self.ledger.head_sequence, self._head_sha256, self._clock_ns())
                yield unit
            self._head_sha256 = unit.head_sha256
            for event in unit.events:
                self.ledger.take(event)
            for listener in self._listeners if unit.events else ():
                listener(unit.events)
        for effect in unit.afterwards:
            effect()

    def append(self, *drafts: EventDraft) -> None:
        """Append events in a transaction of their own."""
        with self.write() as unit:
            for draft in drafts:
                unit.append(draft)

    def events_after(self, sequence: int, case_id: str | None = None, limit: int = PAGE) -> list[Event]:
        """Events after a sequence number, the oldest first; of one case or of all."""
        query = select(EVENTS).where(EVENTS.c.sequence > sequence).order_by(EVENTS.c.sequence).limit(limit)
        if case_id is not None:
            query = query.where(EVENTS.c.case_id == case_id)
        with self._engine.connect() as connection:
            return [decoded(entry_of_row(row)) for row in connection.execute(query)]

    def document(self, sha256: str) -> bytes:
        """A document's content; raises `KeyError` when there is none of that hash."""
        with self._engine.connect() as connection:
            row = connection.execute(select(DOCUMENTS.c.content).where(DOCUMENTS.c.sha256 == sha256)).first()
        if row is None:
            raise KeyError(sha256)
        return bytes(row[0])

    def remembered(self, key: str) -> RememberedAnswer | None:
        """The answer that was given under an idempotency key, if any."""
        with self._engine.connect() as connection:
            row = connection.execute(select(ANSWERS).where(ANSWERS.c.idempotency_key == key)).mappings().first()
        if row is None:
            return None
        answer = Answer(row["status"], row["body_json"], json.loads(row["headers_json"]))
        return RememberedAnswer(row["request_sha256"], answer)

    def is_readable(self) -> bool:
        """Whether the database answers."""
        with self._engine.connect() as connection:
            return connection.execute(select(1)).scalar() == 1

    def close(self) -> None:
        """Close all connections, once the write under way is done."""
        with self._writer:
            self._engine.dispose()

    def _fold_log(self) -> None:
        with self._engine.connect() as connection:
            for row in connection.execute(select(EVENTS).order_by(EVENTS.c.sequence)):
                entry = entry_of_row(row)
                self.ledger.take(decoded(entry))
                self._head_sha256 = entry.sha256
