"""Files of images that a record names, in the folder where imaging stores them."""

import sqlite3
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from sqlalchemy import Connection

from services.ui_api.core.event_data import ImageReceived, ImagesPruned
from services.ui_api.record.codec import decoded
from services.ui_api.record.durable_files import copy_sqlite, write_durably
from services.ui_api.record.verify import entries
from shared.errors import InputError
from shared.parts.files import sha256_of

INDEX_FILE: Final = "index.sqlite"


@dataclass(frozen=True, slots=True)
class CopiedImages:
    """How many image files were copied, and hashes of those that are not there or are damaged."""

    copied: int
    missing: tuple[str, ...]
    damaged: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Numbering:
    """Name of an image store by its index of numbers, and number of its newest image (0: it has none)."""

    store_id: str
    newest: int


def stored_paths(image_dir: Path, sha256: str) -> tuple[Path, ...]:
    """Where imaging may have put a file: in folders by the first two digits of the hash, or flat."""
    return (image_dir / sha256[:2] / f"{sha256}.dcm", image_dir / f"{sha256}.dcm")


def stored_image(image_dir: Path, sha256: str) -> Path | None:
    """The file of an image, or None when there is none."""
    return next((path for path in stored_paths(image_dir, sha256) if path.is_file()), None)


def images_named(connection: Connection) -> tuple[str, ...]:
    """Hashes of the images that a record says are there: received, and not pruned since, in the order of receipt."""
    named: dict[str, None] = {}
    for entry in entries(connection):
        data = None if entry.is_pruned else decoded(entry).data
        if isinstance(data, ImageReceived):
            named[data.image_sha256] = None
        elif isinstance(data, ImagesPruned):
            for sha256 in data.images:
                named.pop(sha256, None)
    return tuple(named)


def copy_images(named: Iterable[str], source: Path, target: Path) -> CopiedImages:
    """Copy image files from one folder into another, each checked by its hash; those that are there whole stay."""
    copied, missing, damaged = 0, list[str](), list[str]()
    for sha256 in named:
        new = stored_paths(target, sha256)[0]
        if new.is_file() and sha256_of(new.read_bytes()) == sha256:
            continue
        found = stored_image(source, sha256)
        content = None if found is None else found.read_bytes()
        if content is None:
            missing.append(sha256)
        elif sha256_of(content) != sha256:
            damaged.append(sha256)
        else:
            write_durably(new, (content,))
            copied += 1
    return CopiedImages(copied, tuple(missing), tuple(damaged))


def copy_index(source: Path, target: Path) -> bool:
    """Copy imaging's index of numbers while imaging runs; False when there is none.

    Raises
    ------
    InputError
        When it cannot be read.
    """
    if not (source / INDEX_FILE).is_file():
        return False
    copy_sqlite(source / INDEX_FILE, target / INDEX_FILE)
    return True


def read_numbering(image_dir: Path, mode: Literal["ro", "rw"]) -> Numbering | None:
    """What the index of a folder numbers; None when there is none.

    Parameters
    ----------
    mode
        `rw` where a program may have ended without closing the index: its log is then written into the file.

    Raises
    ------
    InputError
        When it cannot be read.
    """
    file = image_dir / INDEX_FILE
    if not file.is_file():
        return None
    try:
        with closing(_opened(file, mode)) as index:
            named = index.execute("SELECT id FROM store").fetchone()
            newest = index.execute("SELECT COALESCE(MAX(sequence), 0) FROM images").fetchone()
            return Numbering(str(named[0]), int(newest[0]))
    except (sqlite3.Error, TypeError) as error:
        raise InputError(f"{file} cannot be read: {error}") from None


def image_of_number(image_dir: Path, mode: Literal["ro", "rw"], number: int) -> str | None:
    """Hash of the image that the index gives a number, or None; opened as `read_numbering` does."""
    with closing(_opened(image_dir / INDEX_FILE, mode)) as index:
        found = index.execute("SELECT sha256 FROM images WHERE sequence = ?", (number,)).fetchone()
    return None if found is None else str(found[0])


def _opened(file: Path, mode: Literal["ro", "rw"]) -> sqlite3.Connection:
    return sqlite3.connect(f"{file.absolute().as_uri()}?mode={mode}", uri=True)
