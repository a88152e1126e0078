"""Files that are there whole, on the disk, or not at all; and SQLite databases as single files."""

import os
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Final

from shared.errors import InputError

_LOG_ENDINGS: Final = ("-wal", "-shm", "-journal")


def copy_sqlite(source: Path, target: Path) -> None:
    """Copy a SQLite database while others read and write it, by SQLite's online backup, as one file on the disk.

    Raises
    ------
    InputError
        When it cannot be read, or the copy not be written.
    """
    new = target.with_suffix(".new")
    target.parent.mkdir(parents=True, exist_ok=True)
    new.unlink(missing_ok=True)
    try:
        with (
            closing(sqlite3.connect(f"{source.absolute().as_uri()}?mode=ro", uri=True)) as old,
            closing(sqlite3.connect(new)) as copy,
        ):
            old.backup(copy)  # in one step: a reader's snapshot, which keeps no writer waiting
        as_one_file(new)
    except sqlite3.Error as error:
        new.unlink(missing_ok=True)
        raise InputError(f"{source} cannot be copied to {target}: {error}") from None
    settle(new, target)


def as_one_file(file: Path) -> None:
    """Leave a SQLite database that nobody uses as one file, without the log that lies beside one in use."""
    with closing(sqlite3.connect(file)) as connection:
        connection.execute("PRAGMA journal_mode = DELETE")


def logs_beside(file: Path) -> tuple[Path, ...]:
    """Files that SQLite writes beside a database in use. It reads them into whatever lies under the database's name."""
    return tuple(log for ending in _LOG_ENDINGS if (log := file.with_name(file.name + ending)).exists())


def require_no_logs(file: Path) -> None:
    """Refuse to put a database where the logs of another one lie; raises `InputError`."""
    if logs := logs_beside(file):
        names = " and ".join(log.name for log in logs)
        raise InputError(
            f"{file.parent} has {names}, left behind by another {file.name}: SQLite would write what they hold into a "
            f"restored one; move {names} away to where the other {file.name} is"
        )


def write_durably(file: Path, pieces: Iterable[bytes]) -> None:
    """Write a file so that it is there whole, on the disk, or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    new = file.with_name(f".{file.name}.new")
    with new.open("wb") as stream:
        stream.writelines(pieces)
    settle(new, file)


def settle(new: Path, file: Path) -> None:
    """Flush a file to the disk, then give it its name."""
    for path, then in ((new, lambda: new.replace(file)), (file.parent, lambda: None)):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        then()


def require_empty(folder: Path, wanted: str) -> None:
    """Refuse a folder with something in it, or a file, as the place for `wanted`; raises `InputError`."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder} is not an empty folder; {wanted} needs one of its own")
