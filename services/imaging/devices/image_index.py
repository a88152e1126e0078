"""Numbers of the stored images, their headers and what became of each: an SQLite file beside the images.

Every image has a number from 1 without a gap, also over restarts, so that whoever has seen numbers 1 to 7 and 9 knows
what to ask for. A number is on the disk before its image is published or acknowledged.
"""

import secrets
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from shared.errors import ConfigurationError

# By its header, so that images of earlier releases are found as well.
_UID: Final = """CASE WHEN json_valid(CAST(header AS TEXT))
    THEN json_extract(CAST(header AS TEXT), '$.sop_instance_uid') END"""
_SCHEMA: Final = f"""
CREATE TABLE IF NOT EXISTS store (id TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS images (
    sequence INTEGER PRIMARY KEY,
    sha256 TEXT NOT NULL,
    header BLOB NOT NULL,
    in_run INTEGER NOT NULL,
    state TEXT NOT NULL,
    code TEXT NOT NULL DEFAULT '',
    message TEXT NOT NULL DEFAULT '',
    calibration BLOB,
    attempts INTEGER NOT NULL DEFAULT 0
);
CREATE INDEX IF NOT EXISTS images_by_hash ON images (sha256, sequence);
CREATE INDEX IF NOT EXISTS images_pending ON images (sequence) WHERE state = 'pending';
CREATE INDEX IF NOT EXISTS images_by_uid ON images ({_UID});
"""
PENDING, DONE, SKIPPED = "pending", "done", "skipped"
_COLUMNS: Final = "sequence, sha256, header, state, code, message, attempts"


@dataclass(frozen=True, slots=True)
class IndexedImage:
    """A row: an image, and how far its calibration has come (`state`); `code` and `message` say why it was skipped."""

    sequence: int
    sha256: str
    header: bytes
    state: str
    code: str
    message: str
    attempts: int


class ImageIndex:
    """Safe for several threads. Every method raises `OSError` when the disk does not take it.

    Parameters
    ----------
    file
        Made when it is not there; raises `ConfigurationError` when it cannot be used.
    """

    def __init__(self, file: Path) -> None:
        self._lock = threading.Lock()
        try:
            self._connection = sqlite3.connect(file, check_same_thread=False, isolation_level=None)
            self._connection.execute("PRAGMA journal_mode = WAL")
            self._connection.execute("PRAGMA synchronous = FULL")
            self._connection.executescript(_SCHEMA)
            self.store_id = self._named()
        except sqlite3.Error as error:
            raise ConfigurationError(
                f"the index of the images, {file}, cannot be used ({error}); move it away: the images stay, and "
                "numbers begin anew"
            ) from None

    def _named(self) -> str:
        found = self._connection.execute("SELECT id FROM store").fetchone()
        if found is None:
            self._connection.execute("INSERT INTO store VALUES (?)", (secrets.token_hex(8),))
            found = self._connection.execute("SELECT id FROM store").fetchone()
        return str(found[0])

    def newest_sequence(self) -> int:
        """Number of the newest image; 0 when there is none."""
        with self._connected() as connection:
            return int(connection.execute("SELECT COALESCE(MAX(sequence), 0) FROM images").fetchone()[0])

    def add(self, sequence: int, sha256: str, header: bytes, *, in_run: bool) -> None:
        """Give an image its number, the one after the newest; it is pending."""
        with self._connected() as connection:
            connection.execute(
                "INSERT INTO images (sequence, sha256, header, in_run, state) VALUES (?, ?, ?, ?, ?)",
                (sequence, sha256, header, in_run, PENDING),
            )

    def header(self, sha256: str) -> bytes | None:
        """The newest header of an image, or None."""
        query = "SELECT header FROM images WHERE sha256 = ? ORDER BY sequence DESC LIMIT 1"
        with self._connected() as connection:
            found = connection.execute(query, (sha256,)).fetchone()
        return None if found is None else bytes(found[0])

    def has(self, sha256: str, sop_instance_uid: str) -> bool:
        """Whether an image with this hash or this SOP Instance UID has a number."""
        query = f"SELECT 1 FROM images WHERE sha256 = ? OR {_UID} = ? LIMIT 1"  # noqa: S608 - constants
        with self._connected() as connection:
            return connection.execute(query, (sha256, sop_instance_uid)).fetchone() is not None

    def after(self, sequence: int, most: int) -> list[IndexedImage]:
        """Images after a number, in order."""
        query = f"SELECT {_COLUMNS} FROM images WHERE sequence > ? ORDER BY sequence LIMIT ?"  # noqa: S608 - constants
        with self._connected() as connection:
            return [IndexedImage(*row) for row in connection.execute(query, (sequence, most))]

    def newest_pending(self) -> IndexedImage | None:
        """The newest image that waits for its calibration, or None."""
        query = f"SELECT {_COLUMNS} FROM images WHERE state = 'pending' ORDER BY sequence DESC LIMIT 1"  # noqa: S608
        with self._connected() as connection:
            row = connection.execute(query).fetchone()
        return None if row is None else IndexedImage(*row)

    def is_pending(self, sequence: int) -> bool:
        """Whether an image still waits."""
        with self._connected() as connection:
            row = connection.execute("SELECT state FROM images WHERE sequence = ?", (sequence,)).fetchone()
        return row is not None and row[0] == PENDING

    def require_writable(self) -> None:
        """Write what is written already: raises as whatever else would be written."""
        with self._connected() as connection:
            connection.execute("UPDATE store SET id = id")

    def note_attempt(self, sequence: int) -> None:
        """An image that was left behind is begun again."""
        with self._connected() as connection:
            connection.execute("UPDATE images SET attempts = attempts + 1 WHERE sequence = ?", (sequence,))

    def put_calibration(self, sequence: int, calibration: bytes) -> None:
        """Keep what came of an image, accepted or rejected."""
        with self._connected() as connection:
            connection.execute(
                "UPDATE images SET state = ?, calibration = ? WHERE sequence = ?", (DONE, calibration, sequence)
            )

    def calibration(self, sequence: int) -> bytes | None:
        """What came of an image, or None."""
        with self._connected() as connection:
            row = connection.execute("SELECT calibration FROM images WHERE sequence = ?", (sequence,)).fetchone()
        return None if row is None or row[0] is None else bytes(row[0])

    def skip(self, sequence: int, code: str, message: str) -> None:
        """An image is not calibrated, and why."""
        with self._connected() as connection:
            connection.execute(
                "UPDATE images SET state = ?, code = ?, message = ? WHERE sequence = ?",
                (SKIPPED, code, message, sequence),
            )

    def skip_overtaken_frames(self, before: int, code: str, message: str) -> None:
        """Frames of runs that wait and were overtaken by an image are not calibrated."""
        with self._connected() as connection:
            connection.execute(
                "UPDATE images SET state = ?, code = ?, message = ? WHERE state = ? AND in_run AND sequence < ?",
                (SKIPPED, code, message, PENDING, before),
            )

    @contextmanager
    def _connected(self) -> Iterator[sqlite3.Connection]:
        """The connection, for one statement: each is a transaction of its own, flushed to the disk."""
        with self._lock:
            try:
                yield self._connection
            except sqlite3.Error as error:
                raise OSError(f"the index of the images cannot be read or written: {error}") from error
