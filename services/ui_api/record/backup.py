"""Back a case record up while its gateway runs.

A backup is a folder, the same for both databases::

    record.sqlite    the record, as one SQLite file
    images/          files of the images that the record names, and imaging's index of their numbers
    backup.json      when, by which version, how many events, the chain's head; written last

So a record may also move from one database to the other (`restore`).
"""

from datetime import datetime
from pathlib import Path
from typing import Final, Literal

from alembic.migration import MigrationContext
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from sqlalchemy import Connection, Engine

from services.ui_api.core.chain import ChainBroken, ChainIntact
from services.ui_api.record.database import existing_database, open_database
from services.ui_api.record.durable_files import as_one_file, copy_sqlite, require_empty, settle, write_durably
from services.ui_api.record.engines import is_sqlite
from services.ui_api.record.images import CopiedImages, copy_images, copy_index, images_named
from services.ui_api.record.rows import copy_rows, writing
from services.ui_api.record.verify import verify_record
from shared.errors import InputError

RECORD_FILE: Final = "record.sqlite"
MANIFEST_FILE: Final = "backup.json"
IMAGES_FOLDER: Final = "images"


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
    chain, named = checked_copy(folder / RECORD_FILE)
    copied = copy_images(named, image_dir, folder / IMAGES_FOLDER)
    copy_index(image_dir, folder / IMAGES_FOLDER)
    manifest = _manifest(chain, copied, made_at, software_version)
    text = manifest.model_dump_json(by_alias=True, indent=1) + "\n"
    write_durably(folder / MANIFEST_FILE, (text.encode(),))
    return manifest


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


def checked_copy(file: Path) -> tuple[ChainIntact, tuple[str, ...]]:
    """Chain of a record's copy, and the images that it names."""
    engine = existing_database(f"sqlite:///{file}")
    try:
        verdict = verify_record(engine)
        if isinstance(verdict, ChainBroken):
            raise InputError(f"the record in {file} does not hold: {verdict.message}; use `distalock record verify`")
        with engine.connect() as connection:
            return verdict, images_named(connection)
    finally:
        left_alone(engine)


def left_alone(engine: Engine) -> None:
    """Close a record that is a file, and leave it as one."""
    engine.dispose()
    as_one_file(Path(str(engine.url.database)))


def _copy_record(engine: Engine, file: Path) -> None:
    if is_sqlite(engine):
        copy_sqlite(Path(str(engine.url.database)), file)
        return
    new = file.with_suffix(".new")
    target = open_database(f"sqlite:///{new}")
    snapshot = engine.connect().execution_options(isolation_level="REPEATABLE READ", postgresql_readonly=True)
    with snapshot as source, writing(target) as copy:
        _require_revision(source, copy)
        copy_rows(source, copy)
    left_alone(target)
    settle(new, file)


def _require_revision(source: Connection, target: Connection) -> None:
    have = MigrationContext.configure(source).get_current_revision()
    need = MigrationContext.configure(target).get_current_revision()
    if have != need:
        raise InputError(
            f"the record's schema is of revision {have}, this version's of {need}; start this version's gateway once"
        )
