"""Faults of single processes: killed, hung, restarted, without handles, without memory."""

import os
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Final

from benchmarks.faults.site import CHILDREN, FaultSite
from benchmarks.faults.small_disks import limited

_Injected = Callable[[FaultSite], AbstractContextManager[None]]
# Less than any image takes.
_MEMORY_LEFT_BYTES: Final = 2**20


def killed(name: str) -> _Injected:
    """SIGKILL; started again when the fault goes, or by who watches over it."""

    @contextmanager
    def inject(site: FaultSite) -> Iterator[None]:
        os.kill(site.pid(name), signal.SIGKILL)
        try:
            yield
        finally:
            if name not in CHILDREN:
                site.room.fleet.restart(name)

    return inject


def hung(name: str) -> _Injected:
    """SIGSTOP: connections stay, nothing is said; SIGCONT when the fault goes."""

    @contextmanager
    def inject(site: FaultSite) -> Iterator[None]:
        pid = site.pid(name)
        os.kill(pid, signal.SIGSTOP)
        try:
            yield
        finally:
            with suppress(ProcessLookupError):  # who watches over it has ended it
                os.kill(pid, signal.SIGCONT)

    return inject


def restarted(name: str) -> _Injected:
    """SIGTERM, and started again when the fault goes."""

    @contextmanager
    def inject(site: FaultSite) -> Iterator[None]:
        site.room.fleet.end(name)
        try:
            yield
        finally:
            site.room.fleet.restart(name)

    return inject


def without_handles(name: str) -> _Injected:
    """No file and no connection can be opened any more; what is open stays open."""

    def inject(site: FaultSite) -> AbstractContextManager[None]:
        pid = site.pid(name)
        return limited(resource.RLIMIT_NOFILE, {pid: _first_free_handle(pid)})

    return inject


def without_memory(name: str) -> _Injected:
    """Not more memory than it has now, and a mebibyte."""

    def inject(site: FaultSite) -> AbstractContextManager[None]:
        pid = site.pid(name)
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[0])
        return limited(resource.RLIMIT_AS, {pid: pages * resource.getpagesize() + _MEMORY_LEFT_BYTES})

    return inject


def _first_free_handle(pid: int) -> int:
    used = {int(entry.name) for entry in Path(f"/proc/{pid}/fd").iterdir()}
    return next(number for number in range(len(used) + 1) if number not in used)
