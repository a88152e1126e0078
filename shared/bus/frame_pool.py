"""The pool of shared memory from which a session sends large payloads.

Zenoh has a pool of its own for that ("transport optimization"), which is not used: it is made in the background, so
that the first frame goes by TCP, and it looks for what its readers have released only after it has found no room, so
that of a pool with room for one image every second one goes by TCP.
"""

import threading
from typing import Final

import structlog
import zenoh

from shared.bus.shared_memory import MemoryLimits, pool_bytes, unlock_pools

# Below it, copying costs less than a segment.
SHARED_FROM_BYTES: Final = 64 * 1024
_POLICY: Final = zenoh.shm.GarbageCollect(zenoh.shm.Defragment(zenoh.shm.JustAlloc()))


class FramePool:
    """Made with the first large payload, for most sessions never send one.

    Parameters
    ----------
    size_bytes
        0 for no pool: all goes by TCP.
    """

    def __init__(self, size_bytes: int) -> None:
        self._size_bytes = size_bytes
        self._provider: zenoh.shm.ShmProvider | None = None
        self._lock = threading.Lock()

    @classmethod
    def of_this_process(cls) -> "FramePool":
        """As large as this process may lock."""
        return cls(pool_bytes(MemoryLimits.of_this_process()))

    def placed(self, payload: bytes) -> bytes | zenoh.shm.ZShmMut:
        """Copy a payload into shared memory; itself when it is small, or there is no room."""
        if len(payload) < SHARED_FROM_BYTES or (provider := self._ready_provider()) is None:
            return payload
        try:
            place = provider.alloc(len(payload), _POLICY)
        except zenoh.ZError:  # its readers hold what was sent before
            return payload
        place[:] = payload
        return place

    def _ready_provider(self) -> zenoh.shm.ShmProvider | None:
        with self._lock:
            if self._provider is None and self._size_bytes:
                try:
                    self._provider = zenoh.shm.ShmProvider.default_backend(self._size_bytes)
                except zenoh.ZError as error:
                    structlog.stdlib.get_logger("distalock.bus").warning("no shared memory", detail=str(error))
                    self._size_bytes = 0
                unlock_pools()
            return self._provider
