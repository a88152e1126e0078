"""Verify a case record: the chain of its events, and the hash of every document."""

from collections.abc import Iterator

from sqlalchemy import Connection, Engine, select

from services.ui_api.core.chain import ChainBroken, ChainEntry, ChainIntact, check_chain
from services.ui_api.record.codec import entry_of_row
from services.ui_api.record.tables import DOCUMENTS, EVENTS
from shared.parts.files import sha256_of


def verify_record(engine: Engine) -> ChainIntact | ChainBroken:
    """Check a whole record without changing it.

    Returns
    -------
    ChainIntact | ChainBroken
        Broken names the first event that does not hold; a document that was changed is reported with sequence 0.
    """
    with engine.connect() as connection:
        chain = check_chain(_entries(connection))
        damaged = _damaged_document(connection)
    if isinstance(chain, ChainIntact) and damaged is not None:
        return ChainBroken(0, f"document {damaged} was changed: its content does not give its hash")
    return chain


def _entries(connection: Connection) -> Iterator[ChainEntry]:
    for row in connection.execute(select(EVENTS).order_by(EVENTS.c.sequence)):
        yield entry_of_row(row)


def _damaged_document(connection: Connection) -> str | None:
    rows = connection.execute(select(DOCUMENTS.c.sha256, DOCUMENTS.c.content).execution_options(yield_per=20))
    return next((sha256 for sha256, content in rows if sha256_of(content) != sha256), None)
