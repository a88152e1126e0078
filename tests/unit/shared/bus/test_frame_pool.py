"""What is large is placed in shared memory, as long as there is room."""

from pathlib import Path

import pytest
import zenoh

from shared.bus.frame_pool import SHARED_FROM_BYTES, FramePool
from shared.bus.shared_memory import LEAST_POOL_BYTES, MemoryLimits, shared_memory_shortage

IMAGE = bytes(range(256)) * (4 * 2**20 // 256)
NO_SUCH_ROOM_BYTES = 2**60

needs_shared_memory = pytest.mark.skipif(
    shared_memory_shortage(MemoryLimits.of_this_process()) is not None, reason="this process can hold no pool"
)


def locked_kib() -> int:
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmLck:"))


@needs_shared_memory
def test_a_pool_for_one_image_takes_the_next_as_soon_as_the_first_is_released() -> None:
    pool = FramePool(LEAST_POOL_BYTES)
    for _ in range(3):
        placed = pool.placed(IMAGE)
        assert isinstance(placed, zenoh.shm.ZShmMut)
        assert bytes(placed) == IMAGE
        assert pool.placed(IMAGE) is IMAGE  # the first is still held
        del placed


@needs_shared_memory
def test_nothing_stays_locked() -> None:
    assert isinstance(FramePool(LEAST_POOL_BYTES).placed(IMAGE), zenoh.shm.ZShmMut)
    assert locked_kib() == 0


def test_small_payloads_and_those_without_a_pool_stay_where_they_are() -> None:
    small = bytes(SHARED_FROM_BYTES - 1)
    assert FramePool(LEAST_POOL_BYTES).placed(small) is small
    assert FramePool(0).placed(IMAGE) is IMAGE


def test_a_pool_that_cannot_be_made_costs_no_frame() -> None:
    pool = FramePool(NO_SUCH_ROOM_BYTES)
    assert pool.placed(IMAGE) is IMAGE
    assert pool.placed(IMAGE) is IMAGE
