"""Faults of the case record and of the disks."""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Final

from benchmarks.faults.site import FaultSite, record_folder
from benchmarks.faults.small_disks import filled, read_only

_GATEWAY: Final = "ui_api"
_GARBAGE: Final = b"\x5a"
_WAIT_S: Final = 10.0


@contextmanager
def record_locked(site: FaultSite) -> Iterator[None]:
    """Another program holds the record's write lock."""
    holder = sqlite3.connect(site.record_file, isolation_level=None, timeout=_WAIT_S)
    try:
        holder.execute("BEGIN IMMEDIATE")
        yield
        holder.execute("ROLLBACK")
    finally:
        holder.close()


def record_full(site: FaultSite) -> AbstractContextManager[None]:
    """No byte is left on the record's disk."""
    return filled(record_folder(site.state_dir))


@contextmanager
def record_corrupt(site: FaultSite) -> Iterator[None]:
    """Every byte of the record is overwritten in place; mended as people would: gateway ended, backup put back."""
    backup = record_folder(site.state_dir) / "backup.sqlite"
    _back_up(site.record_file, backup)
    files = [site.record_file, Path(f"{site.record_file}-wal")]
    for file in files:
        _overwrite(file)
    try:
        yield
    finally:
        site.room.fleet.end(_GATEWAY)
        for file in (*files, Path(f"{site.record_file}-shm")):
            file.unlink(missing_ok=True)
        backup.rename(site.record_file)
        site.room.fleet.restart(_GATEWAY)


def disk_full(site: FaultSite) -> AbstractContextManager[None]:
    """No byte is left on the disk of images, logs and keys; the record has its own."""
    return filled(site.state_dir)


def disk_read_only(site: FaultSite) -> AbstractContextManager[None]:
    """Nothing can be written below the state folder, the record included."""
    return read_only([site.state_dir, record_folder(site.state_dir)], site.all_pids)


def _back_up(record: Path, copy: Path) -> None:
    source, target = sqlite3.connect(record, timeout=_WAIT_S), sqlite3.connect(copy)
    try:
        source.backup(target)
    finally:
        target.close()
        source.close()


def _overwrite(file: Path) -> None:
    """In place: the same file, as a failing disk would leave it."""
    if not file.exists():
        return
    with file.open("r+b") as content:
        content.write(_GARBAGE * file.stat().st_size)
        content.flush()
        os.fsync(content.fileno())
