"""Log lines on their way out: whoever logs waits for no disk and no pipe, and never gets an error.

Lines go through a bounded queue to a thread that writes them. A line that does not fit, or that cannot be written
(full disk, closed pipe), is dropped and counted; the count is written before the next line that goes through.
"""

import os
import sys
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Final, Protocol

from shared.threads import supervised_thread

# Chosen: bounds on the memory and on the disk that a service which is not well can fill.
MOST_WAITING: Final = 4096
LOG_FILE_BYTES: Final = 8 * 2**20
LOG_FILES_KEPT: Final = 3
_STANDARD_ERROR: Final = 2


class Sink(Protocol):
    """Where lines leave the process."""

    def write(self, line: str) -> None:
        """Write one line, without its end; raises `OSError` or `ValueError` when it cannot."""


class StandardError:
    """What standard error is at that moment."""

    def write(self, line: str) -> None:
        """See `Sink`."""
        stream = sys.stderr
        if stream is None:
            raise OSError("standard error is closed")
        if stream is not sys.__stderr__:
            print(line, file=stream, flush=True)
            return
        # Past Python's buffer: a thread that hangs in it would abort the process when that ends.
        rest = f"{line}\n".encode(errors="backslashreplace")
        while rest:
            rest = rest[os.write(_STANDARD_ERROR, rest) :]


class RotatingFile:
    """A log file of bounded size: a full one gets the ending ``.1``, the one before ``.2``, and the oldest goes.

    Parameters
    ----------
    most_bytes
        Size at which a file is full.
    kept
        Number of files, the present one included.
    """

    def __init__(self, path: Path, most_bytes: int = LOG_FILE_BYTES, kept: int = LOG_FILES_KEPT) -> None:
        self._path, self._most_bytes, self._kept = path, most_bytes, kept
        self._descriptor: int | None = None
        self._cut_off = False

    def write(self, line: str) -> None:
        """See `Sink`. A file that cannot be opened now is opened again for the next line."""
        content = f"{line}\n".encode(errors="backslashreplace")
        if self._cut_off:
            content = b"\n" + content
        descriptor = self._opened(len(content))
        self._cut_off = True
        if os.write(descriptor, content) < len(content):
            raise OSError(f"{self._path}: a line was cut off")
        self._cut_off = False

    def _opened(self, more_bytes: int) -> int:
        if self._descriptor is None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o640)
        status = os.fstat(self._descriptor)
        if not self._is_at_path(status.st_ino):
            self.close()  # another process of the service has rotated it, or somebody has deleted it
            return self._opened(more_bytes)
        if status.st_size and status.st_size + more_bytes > self._most_bytes:
            self._rotate()
            return self._opened(more_bytes)
        return self._descriptor

    def _is_at_path(self, inode: int) -> bool:
        try:
            return self._path.stat().st_ino == inode
        except FileNotFoundError:
            return False

    def _rotate(self) -> None:
        self.close()
        for number in range(self._kept - 1, 0, -1):
            older = self._numbered(number - 1)
            if older.exists():
                older.replace(self._numbered(number))

    def _numbered(self, number: int) -> Path:
        return self._path.with_name(f"{self._path.name}.{number}") if number else self._path

    def close(self) -> None:
        """Close the file; the next line opens it again."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None


class LineWriter:
    """Writes lines on a thread of its own.

    Parameters
    ----------
    notice
        Makes the line that reports how many were dropped, and why.
    """

    def __init__(self, sink: Sink, notice: Callable[[int, str], str], most_waiting: int = MOST_WAITING) -> None:
        self._sink, self._notice, self._most_waiting = sink, notice, most_waiting
        self._lines: deque[str] = deque()
        self._changed = threading.Condition()
        self._writing = self._closed = False
        self._unreported = 0
        self.dropped = 0
        self.why_dropped = ""
        supervised_thread("log", self._write_forever).start()

    def put(self, line: str) -> None:
        """Hand over a line; never waits for the sink."""
        with self._changed:
            if self._closed or len(self._lines) >= self._most_waiting:
                self._drop(f"more than {self._most_waiting} lines waited to be written")
                return
            self._lines.append(line)
            self._changed.notify_all()

    def note_dropped(self, why: str) -> None:
        """Count a line that could not even be made."""
        with self._changed:
            self._drop(why)

    def flush(self, timeout_s: float) -> bool:
        """Wait until everything is written or dropped; False when that took longer."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._lines and not self._writing, timeout_s)

    def close(self) -> None:
        """Take no more lines; the thread ends after what it has."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _drop(self, why: str) -> None:
        self.dropped += 1
        self._unreported += 1
        self.why_dropped = why

    def _write_forever(self) -> None:
        while (line := self._next()) is not None:
            try:
                self._write(line)
            except Exception as error:  # noqa: BLE001 - whatever a line brings, the next one must be written
                self.note_dropped(str(error) or type(error).__name__)
            with self._changed:
                self._writing = False
                self._changed.notify_all()

    def _next(self) -> str | None:
        with self._changed:
            self._changed.wait_for(lambda: self._lines or self._closed)
            if not self._lines:
                return None
            self._writing = True
            return self._lines.popleft()

    def _write(self, line: str) -> None:
        with self._changed:
            unreported, why = self._unreported, self.why_dropped
        if unreported:
            self._sink.write(self._notice(unreported, why))
            with self._changed:
                self._unreported -= unreported
        self._sink.write(line)
