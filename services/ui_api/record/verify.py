"""Verify a case record: the chain of its events, and every document that they name."""

import json
from collections.abc import Iterator

from sqlalchemy import Connection, Engine, select

from services.ui_api.core.chain import ChainBroken, ChainEntry, ChainIntact, check_chain
from services.ui_api.record.codec import entry_of_row
from services.ui_api.record.tables import DOCUMENTS, EVENTS
from shared.parts.files import sha256_of

# Keys of event data that name a document; `image_sha256` names a file of imaging's instead.
_NAMES_A_DOCUMENT = frozenset(
    {"document_sha256", "overlay_sha256", "header_sha256", "plan_sha256", "page_sha256", "sha256"}
)


def verify_record(engine: Engine) -> ChainIntact | ChainBroken:
    """Check a whole record without changing it.

    Returns
    -------
    ChainIntact | ChainBroken
        Broken names the first event that does not hold, or whose documents do not.
    """
    with engine.connect() as connection:
        chain = check_chain(entries(connection))
        return chain if isinstance(chain, ChainBroken) else _check_documents(connection) or chain


def documents_named(data_json: str) -> frozenset[str]:
    """Hashes of the documents that an event's data names, at any depth; none when the event was pruned."""
    return frozenset(_named(json.loads(data_json))) if data_json else frozenset()


def _named(value: object) -> Iterator[str]:
    if isinstance(value, dict):
        for key, inner in value.items():
            if key in _NAMES_A_DOCUMENT and isinstance(inner, str):
                yield inner
            else:
                yield from _named(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _named(inner)


def entries(connection: Connection) -> Iterator[ChainEntry]:
    """The whole log, in its order."""
    for row in connection.execute(select(EVENTS).order_by(EVENTS.c.sequence)):
        yield entry_of_row(row)


def _check_documents(connection: Connection) -> ChainBroken | None:
    intact, damaged = _documents(connection)
    for entry in entries(connection):
        for sha256 in sorted(documents_named(entry.data_json) - intact):
            finding = "was changed" if sha256 in damaged else "is missing"
            return ChainBroken(
                entry.sequence, f"document {sha256}, which event {entry.sequence} ({entry.kind}) names, {finding}"
            )
    return None


def _documents(connection: Connection) -> tuple[set[str], set[str]]:
    """Hashes of the documents whose content gives their hash, and of those whose content does not."""
    intact: set[str] = set()
    damaged: set[str] = set()
    rows = connection.execute(select(DOCUMENTS.c.sha256, DOCUMENTS.c.content).execution_options(yield_per=20))
    for sha256, content in rows:
        holds = isinstance(content, bytes) and sha256_of(content) == sha256
        (intact if holds else damaged).add(sha256)
    return intact, damaged
