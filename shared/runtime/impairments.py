"""What impairs any service, whatever it does: too little space, too few handles, too little memory, lost log lines."""

import errno
import os
import resource
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
# Chosen: a connection of each client of a room, and the files that are opened for one of its images.
LEAST_FREE_HANDLES: Final = 16
# Chosen: an image of 2048 x 2048 pixels in doubles is 32 MiB, and it is worked on in copies.
LEAST_FREE_MEMORY_MIB: Final = 64.0
# The cause under which services report that their disk fills.
DISK: Final = "disk"
_HANDLES: Final = Path("/proc/self/fd")
_MEMORY_USED: Final = Path("/proc/self/statm")
_MIB: Final = 2**20
_OPENCV_NO_MEMORY: Final = "(-4:"  # cv::Error::StsNoMem, in the text: the attribute `code` is that of the newest error


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
            runtime.status.impair(DISK, lack_of_space(settings.state_dir, settings))
            runtime.status.impair("handles", nearly_out_of_handles())
            runtime.status.impair("memory", nearly_out_of_memory())
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


def lack_of_space(folder: Path, settings: ServiceSettings) -> str | None:
    """A sentence when the folder's disk is nearly full, or on its way there, else None."""
    full = nearly_full(folder, settings.least_free_mib)
    return full or filling(folder, settings.announce_free_percent, settings.announce_free_mib)


def filling(folder: Path, announce_percent: float, announce_mib: float) -> str | None:
    """A sentence when less than that share of the folder's disk is free, and less than that space, else None."""
    try:
        return _filling_of(_disk_of(folder), folder, announce_percent, announce_mib)
    except OSError:
        return None  # which is another finding


def _filling_of(disk: os.statvfs_result, folder: Path, announce_percent: float, announce_mib: float) -> str | None:
    free_mib, all_mib = (blocks * disk.f_frsize / _MIB for blocks in (disk.f_bavail, disk.f_blocks))
    limit_mib = min(all_mib * announce_percent / 100.0, announce_mib)
    if free_mib >= limit_mib:
        return None
    return (
        f"the disk of {folder} fills: {free_mib:.0f} MiB of {all_mib:.0f} MiB are free (limit {limit_mib:.0f} MiB); "
        "remove what has been kept long enough (distalock record prune), or move the state folder to a larger disk"
    )


def nearly_full(folder: Path, least_free_mib: float) -> str | None:
    """A sentence when the folder's disk has less space than that or cannot be asked, else None."""
    try:
        disk = _disk_of(folder)
    except OSError as error:
        return f"the disk of {folder} cannot be asked for its free space ({error.strerror or error}); see to the disk"
    return _lack_of(disk, folder, least_free_mib)


def _disk_of(folder: Path) -> os.statvfs_result:
    return os.statvfs(next(place for place in (folder, *folder.absolute().parents) if place.exists()))


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


def nearly_out_of_handles() -> str | None:
    """A sentence when this process can open few files and connections more, or none, else None."""
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        used = len(os.listdir(_HANDLES))  # noqa: PTH208 - an iterator of paths would stat each
    except OSError as error:
        if error.errno not in (errno.EMFILE, errno.ENFILE):
            return None  # not Linux
        used = limit
    if limit == resource.RLIM_INFINITY or limit - used >= LEAST_FREE_HANDLES:
        return None
    return (
        f"{used} handles for files and connections are in use (limit {limit}, at least {LEAST_FREE_HANDLES} must be "
        "free); raise the limit, or see who holds them"
    )


def nearly_out_of_memory() -> str | None:
    """A sentence when this process may have little more memory than it has, else None."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return None
    try:
        pages = int(_MEMORY_USED.read_text(encoding="ascii").split(maxsplit=1)[0])
    except OSError:
        return None  # not Linux, or no handle is left, which is another finding
    free_mib = (limit - pages * resource.getpagesize()) / _MIB
    if free_mib >= LEAST_FREE_MEMORY_MIB:
        return None
    return (
        f"{max(free_mib, 0.0):.0f} MiB of the process's address space are left (limit {LEAST_FREE_MEMORY_MIB:g} MiB); "
        "raise its limit (ulimit -v)"
    )


def is_lack_of_memory(error: BaseException) -> bool:
    """Whether an error is the process's lack of memory, not the fault of what it worked on.

    That of Python, NumPy and OpenCV says so. Others, as of extensions that do not look, count as such while the process
    is short of memory: what is tried again then shows whose fault it was.
    """
    by_opencv = type(error).__module__ == "cv2" and _OPENCV_NO_MEMORY in str(error)
    return by_opencv or isinstance(error, MemoryError) or nearly_out_of_memory() is not None


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
