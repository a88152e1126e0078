"""Run a module as a program whose wall clock can be stepped.

Call: `python -m benchmarks.faults.stepped_clock FILE MODULE ARGUMENTS`.

The file holds one number of eight bytes, the nanoseconds to add. They are added to `time.time` and `time.time_ns`, from
which the services take every wall-clock time that they write or send. Not stepped: `datetime.now`, the dates in
certificates and Zenoh's own time stamps, which read the clock in compiled code; and no monotonic clock, for setting a
host's clock changes none.
"""

import mmap
import runpy
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path

_NUMBER = struct.Struct("<q")


class ClockFile:
    """The file, as whoever steps the clock sees it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.step_to(0.0)

    def step_to(self, ahead_s: float) -> None:
        """Let the clocks go that much ahead of the true time (behind, when negative)."""
        content = _NUMBER.pack(round(ahead_s * 1e9))
        if not self.path.exists():
            self.path.write_bytes(content)
            return
        with self.path.open("r+b") as file:  # the same file: programs have it in memory
            file.write(content)


def reader(path: Path) -> Callable[[], int]:
    """Reads the nanoseconds to add from now on, without a system call."""
    with path.open("rb") as file:
        shared = mmap.mmap(file.fileno(), _NUMBER.size, prot=mmap.PROT_READ)
    return lambda: int(_NUMBER.unpack_from(shared)[0])


def step_wall_clock(ahead_ns: Callable[[], int]) -> None:
    """Replace this process's wall clock; before anything else is imported that keeps a reference to it."""
    true_ns = time.time_ns

    def time_ns() -> int:
        return true_ns() + ahead_ns()

    time.time_ns = time_ns
    time.time = lambda: time_ns() / 1e9


def run_program(arguments: list[str]) -> None:
    file, module, *others = arguments
    step_wall_clock(reader(Path(file)))
    sys.argv = [module, *others]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    run_program(sys.argv[1:])
