"""What impairs any service, whatever it does: a disk that is nearly full, log lines that cannot be written."""

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Protocol

from shared.runtime.logging import dropped_lines
from shared.runtime.presence import StatusReporter
from shared.runtime.settings import ServiceSettings
from shared.threads import supervised_thread

LOOK_EVERY_S: Final = 2.0
# As long as somebody needs to see it on a health page.
DROPPED_LINES_IMPAIR_S: Final = 60.0
_MIB: Final = 2**20


class Impaired(Protocol):
    """The runtime of a service, as this module sees it."""

    @property
    def status(self) -> StatusReporter:
        """Where impairments are published."""

    def forget_errors(self) -> None:
        """Called regularly."""


@contextmanager
def watched(runtime: Impaired, settings: ServiceSettings) -> Iterator[None]:
    """Look every two seconds, from a thread of its own, for as long as the context lasts."""
    ended = threading.Event()
    lines = _DroppedLines()

    def watch() -> None:
        while True:
            runtime.status.impair("disk", nearly_full(settings.state_dir, settings.least_free_mib))
            runtime.status.impair("log", lines.sentence(time.monotonic()))
            runtime.forget_errors()
            if ended.wait(LOOK_EVERY_S):
                return

    thread = supervised_thread("impairments", watch)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(1.0)


def nearly_full(folder: Path, least_free_mib: float) -> str | None:
    """A sentence when the folder's disk has less space than that or cannot be asked, else None."""
    try:
        existing = next(place for place in (folder, *folder.absolute().parents) if place.exists())
        disk = os.statvfs(existing)
    except OSError as error:
        return f"the disk of {folder} cannot be asked for its free space ({error.strerror or error}); see to the disk"
    return _lack_of(disk, folder, least_free_mib)


def _lack_of(disk: os.statvfs_result, folder: Path, least_free_mib: float) -> str | None:
    if disk.f_flag & os.ST_RDONLY:
        return f"the disk of {folder} is mounted read-only; see to the disk, then mount it anew"
    if disk.f_files > 0 and disk.f_favail == 0:
        return f"the disk of {folder} has room for no more files; delete some, or move the state folder"
    free_mib = disk.f_bavail * disk.f_frsize / _MIB
    if free_mib >= least_free_mib:
        return None
    return (
        f"the disk of {folder} has {free_mib:.0f} MiB free (limit {least_free_mib:g} MiB); "
        "free some space, or move the state folder to a larger disk"
    )


class _DroppedLines:
    """Notices that log lines are being dropped, and that this is over."""

    def __init__(self) -> None:
        self._known, _ = dropped_lines()
        self._last_s = float("-inf")

    def sentence(self, now_s: float) -> str | None:
        count, why = dropped_lines()
        if count > self._known:
            self._known, self._last_s = count, now_s
        if now_s - self._last_s > DROPPED_LINES_IMPAIR_S:
            return None
        return f"{count} log lines could not be written so far ({why}); free space, or see to who reads the log"
