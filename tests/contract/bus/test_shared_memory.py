"""Frames of one sender after another by shared memory, with none of it locked afterwards."""

import os
import threading
import time
from pathlib import Path

import pytest

from shared.bus.port import Sample
from shared.bus.shared_memory import MemoryLimits, shared_memory_shortage
from shared.bus.zenoh_bus import BusSettings, open_bus
from tests.contract.bus.rooms import PATIENCE_S, Collector, RouterProcess

FRAME = bytes(2_000_000)
COUNT = 5
AGAIN_S = 0.05


def locked_kib(pid: int) -> int:
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmLck:"))


def test_frames_of_each_sender_are_shared_and_none_of_it_stays_locked() -> None:
    """The system's limit would be used up by a few starts of a sender, and frames would be lost."""
    if (shortage := shared_memory_shortage(MemoryLimits.of_this_process())) is not None:
        pytest.skip(shortage)
    with RouterProcess() as router, open_bus(BusSettings(router.endpoint, PATIENCE_S)) as receiver:
        received: Collector[Sample] = Collector()
        receiver.subscribe("frame", received.add)
        for start in (1, 2):
            with open_bus(BusSettings(router.endpoint, PATIENCE_S)) as sender:
                frames = sender.publisher("frame")
                deadline_s = time.monotonic() + PATIENCE_S
                while len(received.items) < start * COUNT and time.monotonic() < deadline_s:
                    frames.put(FRAME)
                    threading.Event().wait(AGAIN_S)
        assert sum(sample.by_shared_memory for sample in received.items) >= 0.8 * len(received.items)
        assert all(sample.payload == FRAME for sample in received.items)
        # the router unlocks now and then, not with each frame
        deadline_s = time.monotonic() + PATIENCE_S
        while locked_kib(router.pid) and time.monotonic() < deadline_s:
            threading.Event().wait(AGAIN_S)
        assert locked_kib(router.pid) == 0
        assert locked_kib(os.getpid()) == 0
