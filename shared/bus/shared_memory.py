"""Whether this process can hold the pool of shared memory by which frames travel: without it they go by TCP unnoticed.

Zenoh locks in memory every pool that it makes or maps, and never unmaps one whose sender has gone. So the limit of
locked memory, which is 8 MiB in many containers, says how large a pool can be; and what is mapped is unlocked again at
once, or each start of a sender would take as much of the limit, until frames were lost. Locking has done by then what
it is for here: the memory is there, and cannot be found missing while it is written.
"""

import ctypes
import os
import resource
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

# Mapping the pool delays the first frame: 55 ms with 32 MiB, 200-340 ms with 64 MiB (and then some are lost).
MOST_POOL_BYTES: Final = 32 * 2**20
# An image of 1024 x 1024 pixels has 4 MiB.
LEAST_POOL_BYTES: Final = 9 * 2**19
# Zenoh's list of what is in a pool, which is locked beside it: 1.3 MiB were seen.
_LISTED_BYTES: Final = 3 * 2**19
# What the largest pool takes.
LOCKED_BYTES: Final = MOST_POOL_BYTES + _LISTED_BYTES
# Bytes in a MiB.
_MIB: Final = 2**20
_FOLDER: Final = Path("/dev/shm")  # noqa: S108 - the system's place for shared memory, not a temporary file
_CAPABILITY_IPC_LOCK: Final = 1 << 14
_LIBC: Final = ctypes.CDLL(None)


@dataclass(frozen=True, slots=True)
class MemoryLimits:
    """What the system allows this process.

    Attributes
    ----------
    lockable_bytes
        Memory that may be locked; None for any amount.
    free_bytes
        Free space for shared memory.
    """

    lockable_bytes: int | None
    free_bytes: int

    @classmethod
    def of_this_process(cls) -> "MemoryLimits":
        """Read them from the system."""
        soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
        unlimited = soft == resource.RLIM_INFINITY or bool(_effective_capabilities() & _CAPABILITY_IPC_LOCK)
        free_bytes = shutil.disk_usage(_FOLDER).free if _FOLDER.is_dir() else 0
        return cls(None if unlimited else soft, free_bytes)


def pool_bytes(limits: MemoryLimits) -> int:
    """Size of the pool that can be locked; 0 when an image has no room in it."""
    if limits.lockable_bytes is None:
        return MOST_POOL_BYTES
    size = min(MOST_POOL_BYTES, limits.lockable_bytes - _LISTED_BYTES)
    return size if size >= LEAST_POOL_BYTES else 0


def shared_memory_shortage(limits: MemoryLimits) -> str | None:
    """Why frames go by TCP, and what to do about it; None when they go by shared memory."""
    size = pool_bytes(limits)
    if limits.lockable_bytes is not None and not size:
        return (
            f"frames go by TCP: {limits.lockable_bytes / _MIB:.0f} MiB of memory may be locked, at least "
            f"{(LEAST_POOL_BYTES + _LISTED_BYTES) / _MIB:.0f} MiB are needed for shared memory; raise the limit "
            "(ulimit -l, LimitMEMLOCK of systemd, `ulimits: memlock` of docker-compose)"
        )
    if limits.free_bytes < size:
        return (
            f"frames go by TCP: {_FOLDER} has {limits.free_bytes / _MIB:.0f} MiB free, {size / _MIB:.0f} MiB are "
            "needed for shared memory; free some, or share the host's with the container"
        )
    return None


def unlock_pools() -> None:
    """Unlock what Zenoh has locked, so that the next pool finds the whole limit again; takes 10 µs.

    It unlocks all memory of the process: nothing else here may rely on locked memory.
    """
    _LIBC.munlockall()


def _effective_capabilities() -> int:
    """What this process may do beside the limits: 0 where the system does not say."""
    status = Path(f"/proc/{os.getpid()}/status")
    lines = status.read_text().splitlines() if status.is_file() else []
    return next((int(line.split()[1], 16) for line in lines if line.startswith("CapEff:")), 0)
