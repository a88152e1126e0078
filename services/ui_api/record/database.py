"""Open the case record's database and bring its schema up to date."""

import fcntl
import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.util import CommandError
from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.engine import make_url
from sqlalchemy.engine.interfaces import DBAPIConnection
from sqlalchemy.exc import ArgumentError, DBAPIError
from sqlalchemy.pool import ConnectionPoolEntry, NullPool, Pool

from shared.errors import ConfigurationError

WRITES = "distalock_writes"
BUSY_MS = "distalock_busy_ms"
_BUSY_MS = 5000


def sqlite_url(state_dir: Path) -> str:
    """URL of the default database: a file in the state folder."""
    return f"sqlite:///{state_dir / 'case-record.sqlite'}"


def open_database(url: str) -> Engine:
    """Open a database and upgrade its schema.

    Raises
    ------
    ConfigurationError
        When the URL or the folder is unusable, the file is no database, or a newer version wrote it.
    """
    engine = _engine(url)
    try:
        _make_folder(engine)
        _upgrade(engine)
    except CommandError as error:
        raise ConfigurationError(
            f"case record {url}: its schema is not one that this version knows ({error}); start the newer version"
        ) from None
    except OSError as error:
        raise ConfigurationError(
            f"case record {url}: its folder cannot be made: {error.strerror or error}; set another state_dir"
        ) from None
    except (DBAPIError, sqlite3.Error, UnicodeDecodeError) as error:  # a damaged schema need not be text
        cause = error.orig if isinstance(error, DBAPIError) else error
        raise ConfigurationError(f"case record {url}: cannot be opened: {cause}") from None
    return engine


@contextmanager
def sole_gateway(url: str) -> Iterator[None]:
    """Hold a SQLite record against other gateways, for as long as the context lasts; a kill releases it.

    Two gateways on one record would each number their events by what they have in memory.

    Raises
    ------
    ConfigurationError
        When another gateway holds it, or the folder cannot be written.
    """
    file = _engine(url).url
    if file.get_backend_name() != "sqlite" or not file.database:
        yield
        return
    lock_file = Path(f"{file.database}.lock")
    with ExitStack() as stack:
        try:
            lock_file.parent.mkdir(parents=True, exist_ok=True)
            lock = stack.enter_context(lock_file.open("ab"))
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConfigurationError(
                f"case record {url} is held by another gateway that runs now; end it, or set another state_dir"
            ) from None
        except OSError as error:
            raise ConfigurationError(
                f"case record {url}: its folder cannot be written: {error.strerror or error}; set another state_dir"
            ) from None
        yield


def existing_database(url: str) -> Engine:
    """Open a database as it is, to read it: nothing is created or upgraded.

    Raises
    ------
    ConfigurationError
        When there is none.
    """
    engine = _engine(url)
    file = engine.url.database
    if engine.url.get_backend_name() == "sqlite" and file and not Path(file).is_file():
        raise ConfigurationError(f"there is no case record at {file}; choose its folder with --state-dir")
    return engine


def unpooled(engine: Engine) -> Engine:
    """The same database with a new connection every time: it sees the file as it is, not what another has in memory."""
    if engine.url.get_backend_name() != "sqlite":
        return engine
    return _engine(engine.url.render_as_string(hide_password=False), NullPool)


def _engine(url: str, pool: type[Pool] | None = None) -> Engine:
    try:
        parsed = make_url(url)
        engine = create_engine(parsed, poolclass=pool)
    except (ArgumentError, ImportError) as error:
        raise ConfigurationError(f"database URL {url!r} cannot be used: {error}") from None
    if parsed.get_backend_name() == "sqlite":
        event.listen(engine, "connect", _prepare_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    return engine


def _make_folder(engine: Engine) -> None:
    if engine.url.get_backend_name() == "sqlite" and engine.url.database:
        Path(engine.url.database).parent.mkdir(parents=True, exist_ok=True)


def _prepare_sqlite(connection: DBAPIConnection, _: ConnectionPoolEntry) -> None:
    """WAL, and a flush to the disk with every commit: what was acknowledged survives a kill and a power cut."""
    assert isinstance(connection, sqlite3.Connection)
    connection.isolation_level = None  # transactions begin where `_begin_sqlite` says, not where the driver guesses
    for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", f"busy_timeout={_BUSY_MS}"):
        connection.execute(f"PRAGMA {pragma}")


def _begin_sqlite(connection: Connection) -> None:
    """Writers take the lock at once, so that no transaction fails half-way for want of it."""
    options = connection.get_execution_options()
    connection.exec_driver_sql(f"PRAGMA busy_timeout={options.get(BUSY_MS, _BUSY_MS)}")
    writes = options.get(WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def _upgrade(engine: Engine) -> None:
    config = Config()
    config.set_main_option("script_location", "services.ui_api.record:migrations")
    with engine.connect().execution_options(**{WRITES: True}) as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "head")
        connection.commit()
