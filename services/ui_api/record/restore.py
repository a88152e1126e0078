"""Restore a backup onto a machine that has no record."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from sqlalchemy import Connection, Engine, delete, func, select
from sqlalchemy.exc import DBAPIError

from services.ui_api.core.chain import ChainIntact, check_chain
from services.ui_api.record.backup import (
    IMAGES_FOLDER,
    MANIFEST_FILE,
    RECORD_FILE,
    BackupManifest,
    checked_copy,
    left_alone,
    read_manifest,
)
from services.ui_api.record.database import existing_database, open_database, sole_gateway
from services.ui_api.record.durable_files import copy_sqlite, logs_beside, require_no_logs, settle
from services.ui_api.record.engines import cause_of, engine_of, is_sqlite, shown
from services.ui_api.record.images import INDEX_FILE, copy_images, copy_index, image_of_number, read_numbering
from services.ui_api.record.rows import copy_rows, writing
from services.ui_api.record.tables import EVENTS, REFRESH_TOKENS, SESSIONS
from services.ui_api.record.verify import entries, verify_record
from shared.errors import ConfigurationError, InputError

_RESTORING: Final = ".restoring-"


@dataclass(frozen=True, slots=True)
class KeptIndex:
    """Numbers of the newest image by the index of images that lay there, and by the backup's, which goes no further."""

    newest: int
    of_backup: int

    @property
    def is_newer(self) -> bool:
        """Whether images have come since the backup."""
        return self.newest > self.of_backup


@dataclass(frozen=True, slots=True)
class Restored:
    """The chain of the record that lies there now, and the index of images that was kept; None: it is the backup's."""

    chain: ChainIntact
    kept_index: KeptIndex | None


def restore(folder: Path, url: str, image_dir: Path) -> Restored:
    """Put a backup where no record is. The record appears last: what broke off can be repeated.

    An index of the same image store that goes further than the backup's is kept: what it numbers must not be numbered
    again.

    Raises
    ------
    InputError
        When the folder is no backup, its chain does not hold or ends with another head, there is a record or a part of
        one already, or the record that lies there afterwards is not the one that was backed up.
    ConfigurationError
        When the database cannot be opened.
    """
    manifest = read_manifest(folder)
    engine = engine_of(url)
    with sole_gateway(url), _working_file(engine, image_dir) as file:
        _require_no_record(url)
        kept = _index_to_keep(folder, image_dir)
        copy_sqlite(folder / RECORD_FILE, file)
        chain, named = checked_copy(file)
        if (chain.entries, chain.head_sha256) != (manifest.events, manifest.head_sha256):
            raise InputError(
                f"the record in {folder} has {chain.entries} events and head {chain.head_sha256}, {MANIFEST_FILE} "
                f"names {manifest.events} and {manifest.head_sha256}; use another backup"
            )
        _restore_images(manifest, named, folder, image_dir)
        if kept is None:
            copy_index(folder / IMAGES_FOLDER, image_dir)
        copy = open_database(f"sqlite:///{file}")  # with this version's schema
        _end_sessions(copy)
        if not is_sqlite(engine):
            _restore_rows(copy, open_database(url), chain)
        with copy.connect() as connection:
            _require_same(connection, chain)
        left_alone(copy)
        if is_sqlite(engine):
            settle(file, Path(str(engine.url.database)))
        require_record(url, chain)
    return Restored(chain, kept)


def require_record(url: str, expected: ChainIntact) -> None:
    """Verify the record that lies at a URL; raises `InputError` when it is another one, or does not hold."""
    engine = existing_database(url)
    try:
        found: object = verify_record(engine)
    except DBAPIError as error:
        found = cause_of(error)
    finally:
        engine.dispose()
    if found != expected:
        raise InputError(
            f"the record that now lies at {shown(url)} is not the one that was backed up (expected {expected}, found "
            f"{found}); move it away and restore again"
        )


def _restore_images(manifest: BackupManifest, named: tuple[str, ...], folder: Path, image_dir: Path) -> None:
    lost = copy_images(named, folder / IMAGES_FOLDER, image_dir)
    known = {*manifest.missing_images, *manifest.damaged_images}
    if unknown := {*lost.missing, *lost.damaged} - known:
        raise InputError(
            f"{len(unknown)} images, such as {min(unknown)}, are missing or damaged in {folder}; use another backup"
        )


@contextmanager
def _working_file(engine: Engine, image_dir: Path) -> Iterator[Path]:
    """A file for the copy that is checked and upgraded: beside the file that it becomes, or else beside the images."""
    beside = Path(str(engine.url.database)).parent if is_sqlite(engine) else image_dir.parent
    beside.mkdir(parents=True, exist_ok=True)
    for left in beside.glob(f"{_RESTORING}*"):
        shutil.rmtree(left)  # of a restore that was killed: it holds personal data
    with tempfile.TemporaryDirectory(dir=beside, prefix=_RESTORING) as folder:
        yield Path(folder) / RECORD_FILE


def _end_sessions(copy: Engine) -> None:
    """Whoever held a session on the machine of before signs in anew."""
    with writing(copy) as connection:
        for table in (REFRESH_TOKENS, SESSIONS):
            connection.execute(delete(table))


def _restore_rows(source: Engine, target: Engine, expected: ChainIntact) -> None:
    with source.connect() as old, writing(target) as copy:
        copy_rows(old, copy)
        _require_same(copy, expected)
    target.dispose()


def _require_same(connection: Connection, expected: ChainIntact) -> None:
    found = check_chain(entries(connection))
    if found != expected:
        raise InputError(f"what was restored is not what was backed up (expected {expected}, found {found}); try again")


def _require_no_record(url: str) -> None:
    """A restored record never overwrites another, nor is it mixed with one."""
    engine = engine_of(url)
    if is_sqlite(engine):
        _require_no_file(Path(str(engine.url.database)), url)
        return
    try:
        number = _number_of_events(url)
    except ConfigurationError:
        return
    if number:
        raise InputError(
            f"there is a case record with {number} events at {shown(url)}; restore onto an empty machine, or into an "
            "empty database"
        )


def _require_no_file(file: Path, url: str) -> None:
    if not file.is_file():
        require_no_logs(file)
        return
    try:
        found = f"there is a case record with {_number_of_events(url)} events"
    except DBAPIError as error:
        found = f"there is a file that is no readable case record ({cause_of(error)})"
    logs = "".join(f" and {log.name}" for log in logs_beside(file))
    raise InputError(f"{found} at {shown(url)}; restore onto an empty machine, or move {file.name}{logs} away")


def _number_of_events(url: str) -> int:
    engine = existing_database(url)
    try:
        with engine.connect() as connection:
            return connection.execute(select(func.count()).select_from(EVENTS)).scalar_one()
    finally:
        engine.dispose()


def _index_to_keep(folder: Path, image_dir: Path) -> KeptIndex | None:
    """The index of numbers that lies there, when it goes at least as far as the backup's; None when there is none."""
    index = image_dir / INDEX_FILE
    there, of_backup = read_numbering(image_dir, "rw"), read_numbering(folder / IMAGES_FOLDER, "ro")
    if there is None:
        require_no_logs(index)
        return None
    if of_backup is None:
        raise InputError(
            f"{index} numbers images, and the backup has no index to compare it with; restore onto an empty machine"
        )
    if there.store_id != of_backup.store_id:
        raise InputError(f"{index} numbers the images of another installation; restore onto an empty machine")
    common = min(there.newest, of_backup.newest)
    if image_of_number(image_dir, "rw", common) != image_of_number(folder / IMAGES_FOLDER, "ro", common):
        raise InputError(
            f"{index} and the backup's index give number {common} to different images; restore onto an empty machine"
        )
    if there.newest >= of_backup.newest:
        return KeptIndex(there.newest, of_backup.newest)
    if logs_beside(index):
        raise InputError(f"{index} is in use, and ends with number {there.newest} of {of_backup.newest}; end imaging")
    return None
