"""Engines of the two databases a case record may lie in, prepared so that both keep the same promises.

An acknowledged entry is on the disk, a writer waits for no lock for ever, and a connection that broke is noticed before
it is used.
"""

import sqlite3
from typing import Final

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.engine import URL, make_url
from sqlalchemy.engine.interfaces import DBAPIConnection
from sqlalchemy.exc import ArgumentError, DBAPIError
from sqlalchemy.pool import ConnectionPoolEntry, NullPool, Pool

from shared.errors import ConfigurationError

WRITES: Final = "distalock_writes"
BUSY_MS: Final = "distalock_busy_ms"
# Chosen: longer than any transaction of the gateway, shorter than a client's patience.
_BUSY_MS: Final = 5000
_CONNECT_WITHIN_S: Final = 5
# After this long without an answer the server's host counts as gone; the kernel's own limit is many minutes.
_UNANSWERED_MS: Final = 10_000


def engine_of(url: str, pool: type[Pool] | None = None) -> Engine:
    """An engine for ``sqlite:///FILE`` or ``postgresql://USER:PASSWORD@HOST/NAME``; nothing is opened yet.

    Raises
    ------
    ConfigurationError
        When the URL is none, names another kind of database, or its driver is not installed.
    """
    try:
        parsed = make_url(url)
    except ArgumentError as error:
        raise ConfigurationError(f"database URL {url!r} cannot be used: {error}") from None
    match parsed.get_backend_name():
        case "sqlite":
            engine = create_engine(parsed, poolclass=pool)
            event.listen(engine, "connect", _prepare_sqlite)
            event.listen(engine, "begin", _begin_sqlite)
        case "postgresql":
            engine = _postgresql(parsed, pool)
        case other:
            raise ConfigurationError(
                f"database URL {shown(parsed)!r} cannot be used: {other} is not supported; use sqlite or postgresql"
            )
    return engine


def shown(url: str | URL) -> str:
    """A URL for people: without its password."""
    return make_url(url).render_as_string(hide_password=True)


def is_sqlite(engine: Engine) -> bool:
    """Whether the record is a file of SQLite's."""
    return engine.dialect.name == "sqlite"


def unpooled(engine: Engine) -> Engine:
    """The same database with a new connection every time: it sees the file as it is, not what another has in memory."""
    return engine_of(engine.url.render_as_string(hide_password=False), NullPool) if is_sqlite(engine) else engine


def cause_of(error: Exception) -> str:
    """What a database's driver says, on one line."""
    cause = error.orig if isinstance(error, DBAPIError) else error
    return " ".join(str(cause).split())


def _postgresql(url: URL, pool: type[Pool] | None) -> Engine:
    """Every commit waits for the server's disk, whatever the server's own default is."""
    promises = {
        "options": f"-c synchronous_commit=on -c lock_timeout={_BUSY_MS}",
        "connect_timeout": _CONNECT_WITHIN_S,
        "tcp_user_timeout": _UNANSWERED_MS,
    }
    try:
        engine = create_engine(
            url.set(drivername="postgresql+psycopg"), poolclass=pool, pool_pre_ping=True, connect_args=promises
        )
    except ImportError:
        raise ConfigurationError(
            f"database URL {shown(url)!r} needs the driver psycopg; install distalock[ui-api]"
        ) from None
    event.listen(engine, "begin", _begin_postgresql)
    return engine


def _prepare_sqlite(connection: DBAPIConnection, _: ConnectionPoolEntry) -> None:
    """WAL, and a flush to the disk with every commit: what was acknowledged survives a kill and a power cut."""
    assert isinstance(connection, sqlite3.Connection)
    connection.isolation_level = None  # transactions begin where `_begin_sqlite` says, not where the driver guesses
    for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", f"busy_timeout={_BUSY_MS}"):
        connection.execute(f"PRAGMA {pragma}")


def _begin_sqlite(connection: Connection) -> None:
    """Writers take the lock at once, so that no transaction fails half-way for want of it."""
    options = connection.get_execution_options()
    if BUSY_MS in options:  # on a connection of its own: see `unpooled`
        connection.exec_driver_sql(f"PRAGMA busy_timeout={options[BUSY_MS]}")
    writes = options.get(WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def _begin_postgresql(connection: Connection) -> None:
    busy_ms = connection.get_execution_options().get(BUSY_MS)
    if busy_ms is not None:
        connection.exec_driver_sql(f"SET LOCAL lock_timeout = {int(busy_ms)}")
