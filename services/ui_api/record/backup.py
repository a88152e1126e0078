"""Back a case record up while its gateway runs, and restore it onto an empty machine.

A backup is a folder, the same for both databases::

    record.sqlite    the record, as one SQLite file
    images/          files of the images that the record names, and imaging's index of their numbers
    backup.json      when, by which version, how many events, the chain's head; written last

So a record may also move from one database to the other.
"""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Final, Literal

from alembic.migration import MigrationContext
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from sqlalchemy import Connection, Engine, Table, delete, func, insert, select

from services.ui_api.core.chain import ChainBroken, ChainIntact, check_chain
from services.ui_api.record.database import existing_database, open_database, sole_gateway
from services.ui_api.record.durable_files import as_one_file, copy_sqlite, require_empty, settle, write_durably
from services.ui_api.record.engines import WRITES, engine_of, is_sqlite, shown
from services.ui_api.record.images import INDEX_FILE, CopiedImages, copy_images, copy_index, images_named, store_id
from services.ui_api.record.tables import (
    ANSWERS,
    DOCUMENTS,
    DOCUMENTS_TO_PRUNE,
    EVENTS,
    PRUNINGS,
    REFRESH_TOKENS,
    SESSIONS,
    USERS,
)
from services.ui_api.record.verify import entries, verify_record
from shared.errors import ConfigurationError, InputError

RECORD_FILE: Final = "record.sqlite"
MANIFEST_FILE: Final = "backup.json"
IMAGES_FOLDER: Final = "images"
# In the order in which rows can be inserted: others refer to events. Sessions end with the machine.
_TABLES: Final = (EVENTS, DOCUMENTS, ANSWERS, PRUNINGS, DOCUMENTS_TO_PRUNE, USERS)
_ROWS_AT_ONCE: Final = 50


class BackupManifest(BaseModel):
    """What `backup.json` says."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    schema_name: Literal["distalock/backup/1"] = Field("distalock/backup/1", alias="schema")
    made_at: datetime
    software_version: str
    events: int = Field(ge=0)
    head_sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    images: int = Field(ge=0)
    missing_images: tuple[str, ...]
    damaged_images: tuple[str, ...]

    @property
    def is_complete(self) -> bool:
        """Whether every image that the record names is in the backup."""
        return not self.missing_images and not self.damaged_images


def back_up(engine: Engine, image_dir: Path, folder: Path, made_at: datetime, software_version: str) -> BackupManifest:
    """Copy record, images and index of images into an empty folder. The record is copied as it is at one moment.

    Raises
    ------
    InputError
        When the folder is not empty, or the copy's chain does not hold.
    """
    require_empty(folder, "a backup")
    folder.mkdir(parents=True, exist_ok=True)
    _copy_record(engine, folder / RECORD_FILE)
    chain, named = _checked(folder / RECORD_FILE)
    copied = copy_images(named, image_dir, folder / IMAGES_FOLDER)
    copy_index(image_dir, folder / IMAGES_FOLDER)
    manifest = _manifest(chain, copied, made_at, software_version)
    text = manifest.model_dump_json(by_alias=True, indent=1) + "\n"
    write_durably(folder / MANIFEST_FILE, (text.encode(),))
    return manifest


def restore(folder: Path, url: str, image_dir: Path) -> ChainIntact:
    """Put a backup where no record is. The record appears last: what broke off can be repeated.

    Raises
    ------
    InputError
        When the folder is no backup, its chain does not hold or ends with another head, or there is a record already.
    ConfigurationError
        When the database cannot be opened.
    """
    manifest = read_manifest(folder)
    engine = engine_of(url)
    with sole_gateway(url), _working_file(engine) as file:
        _require_no_record(url)
        _require_no_other_index(folder, image_dir)
        copy_sqlite(folder / RECORD_FILE, file)
        chain, named = _checked(file)
        if (chain.entries, chain.head_sha256) != (manifest.events, manifest.head_sha256):
            raise InputError(
                f"the record in {folder} has {chain.entries} events and head {chain.head_sha256}, {MANIFEST_FILE} "
                f"names {manifest.events} and {manifest.head_sha256}; use another backup"
            )
        _restore_images(manifest, named, folder, image_dir)
        copy = open_database(f"sqlite:///{file}")  # with this version's schema
        _end_sessions(copy)
        if not is_sqlite(engine):
            _restore_rows(copy, open_database(url), chain)
        with copy.connect() as connection:
            _require_same(connection, chain)
        _left_alone(copy)
        if is_sqlite(engine):
            settle(file, Path(str(engine.url.database)))
    return chain


def _restore_images(manifest: BackupManifest, named: tuple[str, ...], folder: Path, image_dir: Path) -> None:
    lost = copy_images(named, folder / IMAGES_FOLDER, image_dir)
    known = {*manifest.missing_images, *manifest.damaged_images}
    if unknown := {*lost.missing, *lost.damaged} - known:
        raise InputError(
            f"{len(unknown)} images, such as {min(unknown)}, are missing or damaged in {folder}; use another backup"
        )
    copy_index(folder / IMAGES_FOLDER, image_dir)


@contextmanager
def _working_file(engine: Engine) -> Iterator[Path]:
    """A file for the copy that is checked and upgraded: beside the record that it becomes, where that is a file."""
    beside = Path(str(engine.url.database)).parent if is_sqlite(engine) else None
    with tempfile.TemporaryDirectory(dir=beside, prefix=".restoring-") as folder:
        yield Path(folder) / RECORD_FILE


def read_manifest(folder: Path) -> BackupManifest:
    """What a backup says of itself; raises `InputError` when the folder is no whole backup."""
    try:
        return BackupManifest.model_validate_json((folder / MANIFEST_FILE).read_bytes())
    except OSError as error:
        raise InputError(f"{folder} is no whole backup: {MANIFEST_FILE}: {error.strerror or error}") from None
    except ValidationError as error:
        raise InputError(f"{folder / MANIFEST_FILE} does not describe a backup: {error.errors()[0]['msg']}") from None


def _manifest(chain: ChainIntact, copied: CopiedImages, made_at: datetime, software_version: str) -> BackupManifest:
    return BackupManifest(
        made_at=made_at,
        software_version=software_version,
        events=chain.entries,
        head_sha256=chain.head_sha256,
        images=copied.copied,
        missing_images=copied.missing,
        damaged_images=copied.damaged,
    )


def _checked(file: Path) -> tuple[ChainIntact, tuple[str, ...]]:
    """Chain of a record's copy, and the images that it names."""
    engine = existing_database(f"sqlite:///{file}")
    try:
        verdict = verify_record(engine)
        if isinstance(verdict, ChainBroken):
            raise InputError(f"the record in {file} does not hold: {verdict.message}; use `distalock record verify`")
        with engine.connect() as connection:
            return verdict, images_named(connection)
    finally:
        _left_alone(engine)


def _left_alone(engine: Engine) -> None:
    engine.dispose()
    as_one_file(Path(str(engine.url.database)))


def _copy_record(engine: Engine, file: Path) -> None:
    if is_sqlite(engine):
        copy_sqlite(Path(str(engine.url.database)), file)
        return
    new = file.with_suffix(".new")
    target = open_database(f"sqlite:///{new}")
    snapshot = engine.connect().execution_options(isolation_level="REPEATABLE READ", postgresql_readonly=True)
    with snapshot as source, _writing(target) as copy:
        _require_revision(source, copy)
        _copy_rows(source, copy)
    _left_alone(target)
    settle(new, file)


def _end_sessions(copy: Engine) -> None:
    """Whoever held a session on the machine of before signs in anew."""
    with _writing(copy) as connection:
        for table in (REFRESH_TOKENS, SESSIONS):
            connection.execute(delete(table))


def _restore_rows(source: Engine, target: Engine, expected: ChainIntact) -> None:
    with source.connect() as old, _writing(target) as copy:
        _copy_rows(old, copy)
        _require_same(copy, expected)
    target.dispose()


@contextmanager
def _writing(engine: Engine) -> Iterator[Connection]:
    with engine.connect().execution_options(**{WRITES: True}) as connection, connection.begin():
        yield connection


def _copy_rows(source: Connection, target: Connection) -> None:
    for table in _TABLES:
        for rows in _pieces(source, table):
            target.execute(insert(table), rows)


def _pieces(source: Connection, table: Table) -> Iterator[list[dict[str, object]]]:
    found = source.execute(select(table).order_by(*table.primary_key).execution_options(yield_per=_ROWS_AT_ONCE))
    for rows in found.mappings().partitions():
        yield [dict(row) for row in rows]


def _require_same(connection: Connection, expected: ChainIntact) -> None:
    found = check_chain(entries(connection))
    if found != expected:
        raise InputError(f"what was restored is not what was backed up (expected {expected}, found {found}); try again")


def _require_revision(source: Connection, target: Connection) -> None:
    have = MigrationContext.configure(source).get_current_revision()
    need = MigrationContext.configure(target).get_current_revision()
    if have != need:
        raise InputError(
            f"the record's schema is of revision {have}, this version's of {need}; start this version's gateway once"
        )


def _require_no_record(url: str) -> None:
    """A restored record never overwrites another, nor is it mixed with one."""
    try:
        engine = existing_database(url)
    except ConfigurationError:
        return
    with engine.connect() as connection:
        number = connection.execute(select(func.count()).select_from(EVENTS)).scalar()
    engine.dispose()
    if is_sqlite(engine) or number:
        raise InputError(
            f"there is a case record with {number} events at {shown(url)}; restore onto an empty machine, or move it "
            "away"
        )


def _require_no_other_index(folder: Path, image_dir: Path) -> None:
    there = store_id(image_dir)
    if there is not None and there != store_id(folder / IMAGES_FOLDER):
        raise InputError(
            f"{image_dir / INDEX_FILE} numbers the images of another installation; restore onto an empty machine"
        )
