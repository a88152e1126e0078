"""Whether this process can hold the pool of shared memory by which frames travel: without it they go by TCP unnoticed.

Zenoh locks the pool in memory. Where the limit for that is too small, as the 8 MiB of many containers, it makes none.
"""

import os
import resource
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

# Mapping the pool delays the first frame: 55 ms with 32 MiB, 200-340 ms with 64 MiB (and then some are lost).
POOL_BYTES: Final = 32 * 2**20
# A process that holds the pool and receives from another was seen to have 34.6 MiB locked.
LOCKED_BYTES: Final = 40 * 2**20
_FOLDER: Final = Path("/dev/shm")  # noqa: S108 - the system's place for shared memory, not a temporary file
_CAPABILITY_IPC_LOCK: Final = 1 << 14
_MIB: Final = 2**20


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


def shared_memory_shortage(limits: MemoryLimits) -> str | None:
    """Why frames go by TCP, and what to do about it; None when they go by shared memory."""
    if limits.lockable_bytes is not None and limits.lockable_bytes < LOCKED_BYTES:
        return (
            f"frames go by TCP: {limits.lockable_bytes / _MIB:.0f} MiB of memory may be locked, "
            f"{LOCKED_BYTES / _MIB:.0f} MiB are needed for shared memory; raise the limit (ulimit -l, "
            "LimitMEMLOCK of systemd, `ulimits: memlock` of docker-compose)"
        )
    if limits.free_bytes < POOL_BYTES:
        return (
            f"frames go by TCP: {_FOLDER} has {limits.free_bytes / _MIB:.0f} MiB free, {POOL_BYTES / _MIB:.0f} MiB are "
            "needed for shared memory; free some, or share the host's with the container"
        )
    return None


def _effective_capabilities() -> int:
    """What this process may do beside the limits: 0 where the system does not say."""
    status = Path(f"/proc/{os.getpid()}/status")
    lines = status.read_text().splitlines() if status.is_file() else []
    return next((int(line.split()[1], 16) for line in lines if line.startswith("CapEff:")), 0)
