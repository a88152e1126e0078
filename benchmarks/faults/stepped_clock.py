"""Programs whose wall clock can be stepped: any, with `stepped_environment`, and the programs that these start.

A file holds one number of eight bytes, the nanoseconds to add. They are added to `time.time` and `time.time_ns`, from
which the services take every wall-clock time that they write or send. Not stepped: `datetime.now`, the dates in
certificates and Zenoh's own time stamps, which read the clock in compiled code; and no monotonic clock, for setting a
host's clock changes none.
"""

import mmap
import os
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from benchmarks.common.places import ROOT

_NUMBER: Final = struct.Struct("<q")
_VARIABLE: Final = "STEPPED_CLOCK_FILE"
_STEPS_EVERY_PROGRAM: Final = Path(__file__).with_name("every_program")


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


def step_where_wanted() -> None:
    """Step this program's wall clock if its environment names a clock file."""
    if (file := os.environ.get(_VARIABLE)) is not None:
        step_wall_clock(reader(Path(file)))


def stepped_environment(clock: ClockFile) -> dict[str, str]:
    """What a program needs in its environment so that its wall clock, and its children's, can be stepped."""
    return {_VARIABLE: str(clock.path), "PYTHONPATH": f"{ROOT}{os.pathsep}{_STEPS_EVERY_PROGRAM}"}
