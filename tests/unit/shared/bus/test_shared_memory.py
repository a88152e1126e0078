"""When frames go by TCP, and what the sentence says about it."""

import pytest

from shared.bus.shared_memory import LOCKED_BYTES, POOL_BYTES, MemoryLimits, shared_memory_shortage

MIB = 2**20
PLENTY = MemoryLimits(None, 1024 * MIB)


@pytest.mark.parametrize("lockable_bytes", [None, LOCKED_BYTES, 64 * MIB])
def test_enough_memory_says_nothing(lockable_bytes: int | None) -> None:
    assert shared_memory_shortage(MemoryLimits(lockable_bytes, POOL_BYTES)) is None


def test_a_limit_of_locked_memory_is_named_with_its_remedy() -> None:
    sentence = shared_memory_shortage(MemoryLimits(8 * MIB, PLENTY.free_bytes))
    assert sentence is not None
    assert sentence.startswith("frames go by TCP: 8 MiB of memory may be locked, 40 MiB are needed for shared memory;")
    assert "ulimits: memlock" in sentence


def test_too_little_space_is_named_with_its_remedy() -> None:
    sentence = shared_memory_shortage(MemoryLimits(None, 16 * MIB))
    assert sentence is not None
    assert sentence.startswith("frames go by TCP: /dev/shm has 16 MiB free, 32 MiB are needed for shared memory;")


def test_the_limits_of_this_process_can_be_read() -> None:
    limits = MemoryLimits.of_this_process()
    assert limits.lockable_bytes is None or limits.lockable_bytes >= 0
    assert limits.free_bytes >= 0
