"""Disks that can be full or read-only: file systems in memory, which this process and its children alone see.

They need a mount namespace of one's own, which util-linux's `unshare` makes without privileges where the kernel lets
it. Where it does not, the faults of disks are not tried.
"""

import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from benchmarks.common.places import ROOT

_MARK: Final = "FAULTS_OWN_MOUNTS"
_BLOCK_BYTES: Final = 2**20


def with_mounts_of_its_own(module: str, arguments: Sequence[str]) -> int | None:
    """Run a module again where it may mount; its exit code, or None when this process may, or nobody can."""
    if has_mounts_of_its_own() or not _can_unshare():
        return None
    command = [*_unshare(), sys.executable, "-m", module, *arguments]
    return subprocess.run(command, env={**os.environ, _MARK: "1", "PYTHONPATH": str(ROOT)}, check=False).returncode


def has_mounts_of_its_own() -> bool:
    """Whether `with_mounts_of_its_own` started this process."""
    return os.environ.get(_MARK) == "1"


def _unshare() -> list[str]:
    return ["unshare", "--user", "--map-root-user", "--mount", "--propagation", "private"]


def _can_unshare() -> bool:
    if shutil.which("unshare") is None or shutil.which("mount") is None:
        return False
    return subprocess.run([*_unshare(), "true"], capture_output=True, check=False).returncode == 0


@contextmanager
def small_disk(folder: Path, size_mib: int) -> Iterator[None]:
    """A disk of its own at a folder, for as long as the context lasts; without own mounts only the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    if not has_mounts_of_its_own():
        yield
        return
    _mount("-t", "tmpfs", "-o", f"size={size_mib}m,mode=0700", "distalock-faults", str(folder))
    try:
        yield
    finally:
        _unmount(folder)


@contextmanager
def filled(folder: Path) -> Iterator[None]:
    """No byte is left on the disk of a folder."""
    ballast = folder / "ballast"
    with ballast.open("wb", buffering=0) as file:
        disk = os.statvfs(folder)
        with suppress(OSError):  # others may have written meanwhile
            os.posix_fallocate(file.fileno(), 0, disk.f_bavail * disk.f_frsize)
        file.seek(0, os.SEEK_END)
        for size in (_BLOCK_BYTES, 1):  # what others have freed meanwhile
            try:
                while True:
                    file.write(b"\0" * size)
            except OSError:
                continue
    try:
        yield
    finally:
        ballast.unlink()


@contextmanager
def read_only(disks: Sequence[Path], pids: Sequence[int]) -> Iterator[None]:
    """Disks, the first of which holds the others, are read-only; these processes can write to no file they have open.

    A mounted file system with files open for writing cannot be made read-only from outside, as the kernel makes it
    after an error of the disk. So a read-only view of each is mounted over it, and the processes' limit on the size of
    files is 0, with which every write to an open file fails.
    """
    _mount("--rbind", str(disks[0]), str(disks[0]))
    try:
        for disk in disks:
            _mount("-o", "remount,bind,ro", str(disk))
        with limited(resource.RLIMIT_FSIZE, dict.fromkeys(pids, 0)):
            yield
    finally:
        _unmount(disks[0])


@contextmanager
def limited(kind: int, limits: dict[int, int]) -> Iterator[None]:
    """A resource limit of some processes, by process id, taken back when the context ends."""
    before = {pid: resource.prlimit(pid, kind) for pid in limits}
    for pid, limit in limits.items():
        resource.prlimit(pid, kind, (limit, before[pid][1]))
    try:
        yield
    finally:
        for pid, limit_before in before.items():
            try:
                resource.prlimit(pid, kind, limit_before)
            except ProcessLookupError:
                continue  # it has ended


def _mount(*arguments: str) -> None:
    subprocess.run(["mount", *arguments], check=True, capture_output=True)  # noqa: S607 - where it is differs


def _unmount(folder: Path) -> None:
    subprocess.run(["umount", "--recursive", "--lazy", str(folder)], check=True)  # noqa: S607 - likewise
