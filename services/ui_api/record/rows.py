"""Rows of a record from one database into another."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Final

from sqlalchemy import Connection, Engine, Table, insert, select

from services.ui_api.record.engines import WRITES
from services.ui_api.record.tables import (
    ANSWERS,
    DOCUMENTS,
    DOCUMENTS_TO_PRUNE,
    EVENTS,
    PASSKEYS,
    PROBE,
    PRUNINGS,
    REFRESH_TOKENS,
    SESSIONS,
    USERS,
)

# In the order in which rows can be inserted: others refer to events, and passkeys to users.
COPIED: Final = (EVENTS, DOCUMENTS, ANSWERS, PRUNINGS, DOCUMENTS_TO_PRUNE, USERS, PASSKEYS)
NOT_COPIED: Final[Mapping[Table, str]] = {
    SESSIONS: "end with the machine: everybody signs in anew",
    REFRESH_TOKENS: "belong to sessions",
    PROBE: "one row, with which a running gateway tries whether the database takes what is written",
}
_ROWS_AT_ONCE: Final = 50


@contextmanager
def writing(engine: Engine) -> Iterator[Connection]:
    """A connection for one transaction that writes."""
    with engine.connect().execution_options(**{WRITES: True}) as connection, connection.begin():
        yield connection


def copy_rows(source: Connection, target: Connection) -> None:
    """Copy what a record consists of into an empty one of the same schema."""
    for table in COPIED:
        for rows in _pieces(source, table):
            target.execute(insert(table), rows)


def _pieces(source: Connection, table: Table) -> Iterator[list[dict[str, object]]]:
    found = source.execute(select(table).order_by(*table.primary_key).execution_options(yield_per=_ROWS_AT_ONCE))
    for rows in found.mappings().partitions():
        yield [dict(row) for row in rows]
