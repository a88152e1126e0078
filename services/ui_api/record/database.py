"""Open the case record's database and bring its schema up to date."""

import fcntl
import sqlite3
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Final

from alembic import command
from alembic.config import Config
from alembic.util import CommandError
from sqlalchemy import Engine, inspect, text
from sqlalchemy.exc import DBAPIError

from services.ui_api.record.engines import WRITES, cause_of, engine_of, is_sqlite, shown
from services.ui_api.record.location import sqlite_url as sqlite_url
from shared.errors import ConfigurationError

# Any number that no other program on the same server uses: these are the letters "distaloc".
_ADVISORY_LOCK: Final = int.from_bytes(b"distaloc", "big")
# The application of a gateway whose front was killed still leaves while the next one starts.
_LEAVING_S: Final = 3.0
_LOOK_EVERY_S: Final = 0.05


def open_database(url: str) -> Engine:
    """Open a database and upgrade its schema.

    Raises
    ------
    ConfigurationError
        When the URL or the folder is unusable, the file is no database, or a newer version wrote it.
    """
    engine = engine_of(url)
    try:
        with ExitStack() as unusable:
            unusable.callback(engine.dispose)
            _make_folder(engine)
            upgrade(engine)
            unusable.pop_all()
    except CommandError as error:
        raise ConfigurationError(
            f"case record {shown(url)}: its schema is not one that this version knows ({error}); start the newer "
            "version"
        ) from None
    except OSError as error:
        raise ConfigurationError(
            f"case record {shown(url)}: its folder cannot be made: {error.strerror or error}; set another state_dir"
        ) from None
    except (DBAPIError, sqlite3.Error, UnicodeDecodeError) as error:  # a damaged schema need not be text
        raise ConfigurationError(f"case record {shown(url)}: cannot be opened: {cause_of(error)}") from None
    return engine


@contextmanager
def sole_gateway(url: str) -> Iterator[None]:
    """Hold a record against other gateways, for as long as the context lasts; a kill releases it.

    Two gateways on one record would each number their events by what they have in memory.

    Raises
    ------
    ConfigurationError
        When another gateway holds it, or the folder cannot be written.
    """
    engine = engine_of(url)
    if not is_sqlite(engine):
        with _sole_on_server(engine, url):
            yield
    elif not engine.url.database:
        yield
    else:
        with _sole_on_file(Path(f"{engine.url.database}.lock"), url):
            yield


@contextmanager
def _sole_on_file(lock_file: Path, url: str) -> Iterator[None]:
    with ExitStack() as stack:
        try:
            lock_file.parent.mkdir(parents=True, exist_ok=True)
            lock = stack.enter_context(lock_file.open("ab"))
            _lock_within(lock, _LEAVING_S)
        except BlockingIOError:
            raise _held_by_another(url) from None
        except OSError as error:
            raise ConfigurationError(
                f"case record {shown(url)}: its folder cannot be written: {error.strerror or error}; set another "
                "state_dir"
            ) from None
        yield


@contextmanager
def _sole_on_server(engine: Engine, url: str) -> Iterator[None]:
    """An advisory lock, which lasts as long as its connection.

    A server that is restarted forgets it; the log's primary key then still refuses what a second gateway numbers alike.
    """
    with ExitStack() as stack:
        stack.callback(engine.dispose)
        try:
            connection = stack.enter_context(engine.connect().execution_options(isolation_level="AUTOCOMMIT"))
            held = connection.execute(text("SELECT pg_try_advisory_lock(:key)"), {"key": _ADVISORY_LOCK}).scalar()
        except DBAPIError as error:
            raise ConfigurationError(f"case record {shown(url)}: cannot be opened: {cause_of(error)}") from None
        if not held:
            raise _held_by_another(url)
        yield
        connection.invalidate()  # its server may be gone: nothing is left to say to it


def _held_by_another(url: str) -> ConfigurationError:
    return ConfigurationError(
        f"case record {shown(url)} is held by another gateway that runs now; end it, or set another state_dir"
    )


def _lock_within(lock: IO[bytes], patience_s: float) -> None:
    """Take a lock; raises `BlockingIOError` when another process does not let go of it in time."""
    deadline_s = time.monotonic() + patience_s
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(_LOOK_EVERY_S)
        else:
            return


def existing_database(url: str) -> Engine:
    """Open a database as it is, to read it: nothing is created or upgraded.

    Raises
    ------
    ConfigurationError
        When there is none.
    """
    engine = engine_of(url)
    if is_sqlite(engine):
        file = engine.url.database
        if file and not Path(file).is_file():
            raise ConfigurationError(f"there is no case record at {file}; choose its folder with --state")
        return engine
    try:
        with ExitStack() as unusable:
            unusable.callback(engine.dispose)
            if not inspect(engine).has_table("events"):
                raise ConfigurationError(f"there is no case record at {shown(url)}; choose another database URL")
            unusable.pop_all()
    except DBAPIError as error:
        raise ConfigurationError(f"case record {shown(url)}: cannot be opened: {cause_of(error)}") from None
    return engine


def upgrade(engine: Engine, revision: str = "head") -> None:
    """Bring the schema to a revision; others may read meanwhile, and find the old one or the new one."""
    config = Config()
    config.set_main_option("script_location", "services.ui_api.record:migrations")
    with engine.connect().execution_options(**{WRITES: True}) as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, revision)
        connection.commit()


def _make_folder(engine: Engine) -> None:
    if is_sqlite(engine) and engine.url.database:
        Path(engine.url.database).parent.mkdir(parents=True, exist_ok=True)
