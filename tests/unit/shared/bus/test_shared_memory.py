"""How large the pool of frames is, when frames go by TCP, and what the sentence says about it."""

import pytest

from shared.bus.shared_memory import (
    LEAST_POOL_BYTES,
    LOCKED_BYTES,
    MOST_POOL_BYTES,
    MemoryLimits,
    pool_bytes,
    shared_memory_shortage,
)

MIB = 2**20
PLENTY = MemoryLimits(None, 1024 * MIB)
IMAGE_BYTES = 4 * 1024 * 1024


@pytest.mark.parametrize("lockable_bytes", [None, LOCKED_BYTES, 64 * MIB])
def test_where_enough_may_be_locked_the_pool_is_large_and_nothing_is_said(lockable_bytes: int | None) -> None:
    limits = MemoryLimits(lockable_bytes, MOST_POOL_BYTES)
    assert pool_bytes(limits) == MOST_POOL_BYTES
    assert shared_memory_shortage(limits) is None


def test_the_usual_limit_of_a_container_has_room_for_an_image() -> None:
    limits = MemoryLimits(8 * MIB, 8 * MIB)
    assert IMAGE_BYTES < LEAST_POOL_BYTES <= pool_bytes(limits) < 8 * MIB
    assert shared_memory_shortage(limits) is None


def test_a_limit_of_locked_memory_is_named_with_its_remedy() -> None:
    limits = MemoryLimits(5 * MIB, PLENTY.free_bytes)
    sentence = shared_memory_shortage(limits)
    assert pool_bytes(limits) == 0
    assert sentence is not None
    assert sentence.startswith("frames go by TCP: 5 MiB of memory may be locked, at least 6 MiB are needed for shared")
    assert "ulimits: memlock" in sentence


def test_too_little_space_is_named_with_its_remedy() -> None:
    sentence = shared_memory_shortage(MemoryLimits(None, 16 * MIB))
    assert sentence is not None
    assert sentence.startswith("frames go by TCP: /dev/shm has 16 MiB free, 32 MiB are needed for shared memory;")


def test_the_limits_of_this_process_can_be_read() -> None:
    limits = MemoryLimits.of_this_process()
    assert limits.lockable_bytes is None or limits.lockable_bytes >= 0
    assert limits.free_bytes >= 0
