"""Watch a folder into which a C-arm, or a person, puts image files."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
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


@dataclass(frozen=True, slots=True)
class _Listed:
    """A file as it lies in the folder.

    Attributes
    ----------
    absent_at_s
        When the folder was last read without it, as it looks now: it came later. None: it lay there before.
    belongs_in
        The subfolder to which it has yet to be moved, for it has been handed over; empty before that.
    """

    path: Path
    seen: _Seen
    absent_at_s: float | None
    belongs_in: str = ""


@dataclass(frozen=True, slots=True)
class _Look:
    """The folder when it was last read: when that began, and its files, the oldest first."""

    at_s: float
    files: dict[Path, _Listed]

    def whole(self, before: "_Look | None") -> list[_Listed]:
        """Files that look as they did at the look before."""
        earlier = {} if before is None else before.files
        return [file for path, file in self.files.items() if path in earlier and earlier[path].seen == file.seen]


class FolderSource:
    """Takes every file that appears in a folder and moves it to its subfolder `taken`, or `refused`.

    A file that cannot be moved is not taken again: that is remembered for as long as it lies there unchanged.

    Parameters
    ----------
    folder
        Where files appear. Those that begin with a dot or end in .part or .tmp are left alone, and so are subfolders.
    log
        Gets one line for each refusal.
    monotonic_s
        The clock by which files wait.
    """

    def __init__(self, folder: Path, log: Log, monotonic_s: Callable[[], float] = time.monotonic) -> None:
        self._folder = folder
        self._log = log
        self._monotonic_s = monotonic_s

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
        ended, first = threading.Event(), self._look(None)
        worker = supervised_thread("watch folder", lambda: self._watch(take, ended, first))
        worker.start()
        try:
            yield f"folder {self._folder}"
        finally:
            ended.set()
            worker.join(5.0)

    def _watch(self, take: Take, ended: threading.Event, look: _Look | None) -> None:
        while not ended.wait(_POLL_S):
            before, look = look, self._look(look)
            if look is None or look is before:
                continue
            for file in look.whole(before):
                if ended.is_set():
                    return
                look.files[file.path] = self._handle(file, take)

    def _look(self, before: _Look | None) -> _Look | None:
        """Read the folder; when it cannot be read, what is known of it stays as it was."""
        now_s, found = self._monotonic_s(), dict[Path, _Seen]()
        try:
            for file in self._folder.iterdir():
                seen = _image_seen(file)
                if seen is not None:
                    found[file] = seen
        except OSError as error:
            self._log.error("folder not read", folder=str(self._folder), detail=str(error))
            return before
        ordered = dict(sorted(found.items(), key=lambda item: (item[1].changed_ns, item[0].name)))
        return _Look(now_s, _listed(ordered, before))

    def _handle(self, file: _Listed, take: Take) -> _Listed:
        """Hand a file over, if that has not been done, and move it away; returns what is known of it then."""
        belongs_in = file.belongs_in or self._offer(file, take)
        if belongs_in:
            self._move(file, belongs_in)
        return replace(file, belongs_in=belongs_in)

    def _offer(self, file: _Listed, take: Take) -> str:
        """Hand a file over; returns where it belongs, nothing while it stays to be offered again."""
        try:
            content = _content(file)
            if content is None:
                return ""
            waited_s = None if file.absent_at_s is None else self._monotonic_s() - file.absent_at_s
            take(content, file.path.name, waited_s)
        except ImageUnreadable as error:
            self._log.warning("image refused", sender=file.path.name, detail=str(error))
            return REFUSED
        except (Refused, OSError) as error:
            self._log.error("image not taken", sender=file.path.name, detail=str(error))
            return ""
        return TAKEN

    def _move(self, file: _Listed, folder: str) -> None:
        """Move a file away; one of the same name that lies there already is replaced.

        It stays when it was overwritten since it was read: it is another image, which is taken next.
        """
        target = self._folder / folder / file.path.name
        try:
            if _seen(file.path) == file.seen:
                target.parent.mkdir(exist_ok=True)
                file.path.replace(target)
        except FileNotFoundError:
            pass  # whoever put it there has removed it
        except OSError as error:
            if not file.belongs_in:  # reported once, and tried again at every look
                detail = f"{error}; it is not taken again: move it away, or what stands in its place"
                self._log.error("file not moved", file=str(file.path), detail=detail)


def _listed(seen: dict[Path, _Seen], before: _Look | None) -> dict[Path, _Listed]:
    """The files of a look; what is known of those that look as before is kept, all else forgotten."""
    files: dict[Path, _Listed] = {}
    for path, look in seen.items():
        known = None if before is None else before.files.get(path)
        if known is None or known.seen != look:
            known = _Listed(path, look, None if before is None else before.at_s)
        files[path] = known
    return files


def _image_seen(file: Path) -> _Seen | None:
    """What a file looks like; None when it cannot be an image, or is gone already."""
    if file.name.startswith(".") or file.suffix.lower() in _UNFINISHED or not file.is_file():
        return None
    with suppress(FileNotFoundError):
        return _seen(file)
    return None


def _seen(file: Path) -> _Seen:
    status = file.stat()
    return _Seen(status.st_size, status.st_mtime_ns)


def _content(file: _Listed) -> bytes | None:
    """What is in a file; None when it has been changed since it was looked at, so that it may not be whole."""
    if file.seen.size > _LARGEST_BYTES:
        raise ImageUnreadable(f"{file.path.name}: {file.seen.size} bytes (limit {_LARGEST_BYTES}); send single images")
    content = file.path.read_bytes()
    return content if _seen(file.path) == file.seen else None
