"""The far end as a process: `python -m benchmarks.bus.far_end KIND ENDPOINT STATE`.

It says "ready", then for each line that it reads how long the frames since the line before took, in seconds.
"""

import json
import sys
import threading
import time
from pathlib import Path

from benchmarks.bus.ends import KINDS, far_end


class Latencies:
    """Seconds from sending to handling, of each frame since they were asked for the last time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._seconds: list[float] = []

    def note(self, _frame: bytes, header: bytes) -> None:
        """A frame came, which says when it was sent by the clock of this host."""
        with self._lock:
            self._seconds.append((time.monotonic_ns() - int(header)) / 1e9)

    def taken(self) -> list[float]:
        """Hand them over."""
        with self._lock:
            seconds, self._seconds = self._seconds, []
            return seconds


def run() -> int:
    """Run until standard input ends."""
    kind = next(kind for kind in KINDS if kind == sys.argv[1])
    latencies = Latencies()
    with far_end(kind, sys.argv[2], Path(sys.argv[3]), latencies.note):
        print("ready", flush=True)
        for _ in sys.stdin:
            print(json.dumps(latencies.taken()), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(run())
