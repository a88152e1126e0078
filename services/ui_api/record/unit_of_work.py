"""One unit of work on the record: events, documents and a remembered answer, written together or not at all."""

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Final

from sqlalchemy import Connection, bindparam, delete, insert, select, update
from sqlalchemy.sql.dml import UpdateBase

from services.ui_api.core.chain import ChainEntry, entry_sha256
from services.ui_api.core.events import KIND_OF_DATA, Event, EventDraft
from services.ui_api.record.codec import data_json, event_of
from services.ui_api.record.tables import ANSWERS, DOCUMENTS, DOCUMENTS_TO_PRUNE, EVENTS, PRUNINGS
from shared.parts.files import sha256_of


@dataclass(frozen=True, slots=True)
class Answer:
    """An HTTP answer as it is remembered with its idempotency key. `body_json` is JSON text."""

    status: int
    body_json: str
    headers: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class RememberedAnswer:
    """An answer and the fingerprint of the request that it answered."""

    request_sha256: str
    answer: Answer


# Made once: a statement that is made anew takes longer than the database takes for it.
_INSERT_EVENT: Final = insert(EVENTS)
_INSERT_DOCUMENT: Final = insert(DOCUMENTS)
_INSERT_ANSWER: Final = insert(ANSWERS)
_FIND_DOCUMENT: Final = select(DOCUMENTS.c.sha256).where(DOCUMENTS.c.sha256 == bindparam("named"))


class UnitOfWork:
    """What may be done within one transaction. `CaseRecord.write` makes it and commits it."""

    def __init__(self, connection: Connection, head_sequence: int, head_sha256: str, now_ns: int) -> None:
        self._connection = connection
        self._head_sequence = head_sequence
        self.head_sha256 = head_sha256
        self.now_ns = now_ns
        self.events: list[Event] = []
        self.afterwards: list[Callable[[], None]] = []

    def append(self, draft: EventDraft) -> Event:
        """Append an event to the log."""
        sequence = self._head_sequence + 1
        text = data_json(draft.data)
        kind = KIND_OF_DATA[type(draft.data)]
        entry = ChainEntry(sequence, self.now_ns, draft.case_id, draft.who, draft.why, kind, text, self.head_sha256, "")
        entry = replace(entry, sha256=entry_sha256(entry))
        self._connection.execute(_INSERT_EVENT, _columns(entry))
        self._head_sequence, self.head_sha256 = sequence, entry.sha256
        event = event_of(sequence, self.now_ns, draft)
        self.events.append(event)
        return event

    def put_document(self, content: bytes, media_type: str = "application/json") -> str:
        """Store a document once, under its SHA-256, which is returned."""
        sha256 = sha256_of(content)
        known = self._connection.execute(_FIND_DOCUMENT, {"named": sha256}).first()
        if known is None:
            columns = {"sha256": sha256, "media_type": media_type, "content": content}
            self._connection.execute(_INSERT_DOCUMENT, columns)
        return sha256

    def remember(self, key: str, request_sha256: str, answer: Answer) -> None:
        """Store an answer with its idempotency key."""
        columns = {
            "idempotency_key": key,
            "request_sha256": request_sha256,
            "status": answer.status,
            "headers_json": json.dumps(dict(answer.headers)),
            "body_json": answer.body_json,
            "event_sequence": self._head_sequence or None,
            "answered_at_ns": self.now_ns,
        }
        self._connection.execute(_INSERT_ANSWER, columns)

    def erase_case(self, case_id: str, announcement: Event, documents: Collection[str]) -> None:
        """Empty all events of a case, and delete documents, after the event that records it was appended.

        The database allows it because it is declared first (`migrations.versions.r0003_append_only`).
        """
        run = self._connection.execute
        declared = announcement.sequence
        run(insert(PRUNINGS).values(case_id=case_id, event_sequence=declared))
        of_case = EVENTS.c.case_id == case_id
        numbers = select(EVENTS.c.sequence).where(of_case)
        run(delete(ANSWERS).where(ANSWERS.c.event_sequence.in_(numbers)))
        run(update(EVENTS).where(of_case).values(who="", why="", data_json=""))
        for sha256 in documents:
            run(insert(DOCUMENTS_TO_PRUNE).values(sha256=sha256, event_sequence=declared))
            run(delete(DOCUMENTS).where(DOCUMENTS.c.sha256 == sha256))

    def change(self, statement: UpdateBase) -> int:
        """Change tables that are no part of the log, such as those of accounts; the number of rows it concerned."""
        return self._connection.execute(statement).rowcount

    def after_commit(self, effect: Callable[[], None]) -> None:
        """Have something done once the transaction is on the disk, and not at all if it fails."""
        self.afterwards.append(effect)


def _columns(entry: ChainEntry) -> dict[str, int | str | None]:
    return {
        "sequence": entry.sequence,
        "at_ns": entry.at_ns,
        "case_id": entry.case_id,
        "who": entry.who,
        "why": entry.why,
        "kind": entry.kind,
        "data_json": entry.data_json,
        "previous_sha256": entry.previous_sha256,
        "sha256": entry.sha256,
    }
