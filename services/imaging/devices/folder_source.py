"""Watch a folder into which a C-arm, or a person, puts image files."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from services.imaging.devices.source import Refused, Take
from shared.errors import ConfigurationError, ImageUnreadable
from shared.runtime.logging import Log
from shared.threads import supervised_thread

TAKEN, REFUSED = "taken", "refused"
# Chosen: short beside the seconds that an image takes to be written and localised.
_POLL_S = 0.25
# Chosen: twice the largest image that is accepted, 8192 x 8192 of 16 bits.
_LARGEST_BYTES = 256 * 2**20
_UNFINISHED = (".part", ".tmp", ".partial", ".crdownload")


@dataclass(frozen=True, slots=True)
class _Seen:
    """What a file looked like; a file is whole when it looks the same twice."""

    size: int
    changed_ns: int


class FolderSource:
    """Takes every file that appears in a folder and moves it to its subfolder `taken`, or `refused`.

    Parameters
    ----------
    folder
        Where files appear. Those that begin with a dot or end in .part or .tmp are left alone, and so are subfolders.
    log
        Gets one line for each refusal.
    """

    def __init__(self, folder: Path, log: Log) -> None:
        self._folder = folder
        self._log = log

    @contextmanager
    def receiving(self, take: Take) -> Iterator[str]:
        """Look into the folder four times a second for as long as the context lasts."""
        try:
            for name in (TAKEN, REFUSED):
                (self._folder / name).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigurationError(
                f"the watched folder {self._folder} cannot be written ({error.strerror or error}); "
                "allow it or set another watched_folder"
            ) from None
        ended = threading.Event()
        worker = supervised_thread("watch folder", lambda: self._watch(take, ended))
        worker.start()
        try:
            yield f"folder {self._folder}"
        finally:
            ended.set()
            worker.join(5.0)

    def _watch(self, take: Take, ended: threading.Event) -> None:
        before: dict[Path, _Seen] = {}
        while not ended.is_set():
            now = self._files()
            for file in [f for f, seen in now.items() if before.get(f) == seen]:
                if ended.is_set():
                    return
                self._handle(file, take)
            before = now
            ended.wait(_POLL_S)

    def _files(self) -> dict[Path, _Seen]:
        """Files that may be images, the oldest first."""
        found: dict[Path, _Seen] = {}
        try:
            for file in self._folder.iterdir():
                if file.name.startswith(".") or file.suffix.lower() in _UNFINISHED or not file.is_file():
                    continue
                status = file.stat()
                found[file] = _Seen(status.st_size, status.st_mtime_ns)
        except OSError as error:
            self._log.error("folder not read", folder=str(self._folder), detail=str(error))
        return dict(sorted(found.items(), key=lambda item: (item[1].changed_ns, item[0].name)))

    def _handle(self, file: Path, take: Take) -> None:
        try:
            if file.stat().st_size > _LARGEST_BYTES:
                raise ImageUnreadable(  # noqa: TRY301 - the same refusal as that of a damaged file
                    f"{file.name}: {file.stat().st_size} bytes (limit {_LARGEST_BYTES}); send single images"
                )
            take(file.read_bytes(), file.name)
        except ImageUnreadable as error:
            self._log.warning("image refused", sender=file.name, detail=str(error))
            self._move(file, REFUSED)
        except (Refused, OSError) as error:
            self._log.error("image not taken", sender=file.name, detail=str(error))
        else:
            self._move(file, TAKEN)

    def _move(self, file: Path, folder: str) -> None:
        """Move a file away; one of the same name that lies there already is replaced."""
        try:
            file.replace(self._folder / folder / file.name)
        except OSError as error:
            self._log.error("file not moved", file=str(file), detail=str(error))
