"""Events to rows and back: data as canonical JSON, whose text is what the chain hashes."""

import json
from dataclasses import asdict
from functools import cache

from pydantic import TypeAdapter
from sqlalchemy import Row

from services.ui_api.core.chain import ChainEntry
from services.ui_api.core.events import DATA_OF_KIND, Event, EventData, EventDraft, EventKind

EventRow = Row[int, int, str | None, str, str, str, str, str, str]


@cache
def _adapter(kind: EventKind) -> TypeAdapter[EventData]:
    return TypeAdapter(DATA_OF_KIND[kind])


def data_json(data: EventData) -> str:
    """Canonical JSON of an event's data: sorted keys, no spaces, no NaN."""
    return json.dumps(asdict(data), ensure_ascii=False, sort_keys=True, separators=(",", ":"), allow_nan=False)


def event_of(sequence: int, at_ns: int, draft: EventDraft) -> Event:
    """The event that a draft becomes at its place in the log."""
    return Event(sequence, at_ns, draft.case_id, draft.who, draft.why, draft.data)


def decoded(entry: ChainEntry) -> Event:
    """A stored entry as an event."""
    data = _adapter(EventKind(entry.kind)).validate_json(entry.data_json)
    return Event(entry.sequence, entry.at_ns, entry.case_id, entry.who, entry.why, data)


def entry_of_row(row: EventRow) -> ChainEntry:
    """A row of the `events` table, its columns in the table's order."""
    sequence, at_ns, case_id, who, why, kind, data, previous_sha256, sha256 = row
    return ChainEntry(sequence, at_ns, case_id, who, why, kind, data, previous_sha256, sha256)
