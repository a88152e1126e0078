"""The machine: processors, memory, limits, clock, disk."""

import ctypes
import os
import resource
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from shared.bus.shared_memory import MemoryLimits, pool_bytes, shared_memory_shortage
from shared.doctor.finding import Finding, attention, unknown, well, wrong
from shared.runtime.impairments import lack_of_space
from shared.runtime.settings import ServiceSettings
from shared.scheduling import has_precedence, precedence

# Measured: an installation holds 1.5 GB with images of 1024 pixels.
_LEAST_MEMORY_MIB: Final = 3000.0
# Chosen: two thousand connections of the gateway, and what the services open.
_LEAST_HANDLES: Final = 4096
_MIB: Final = 2**20
# What Linux's adjtimex returns for a clock that nothing keeps right (TIME_ERROR).
_NOT_SYNCHRONISED: Final = 5
_TIMEX_BYTES: Final = 512  # more than any system's struct timex
# Chosen: file systems keep whole seconds, and other hosts that write there have clocks of their own.
_CLOCK_BEHIND_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class Machine:
    """What was read from the system.

    Attributes
    ----------
    synchronised
        Whether a time service keeps the clock right; None where the system does not say.
    newest_file_s
        Time of the newest file of the state folder, seconds since 1970; None without one.
    """

    processors: int
    memory_mib: float
    handles: int
    locked: MemoryLimits
    real_time: bool
    synchronised: bool | None
    now_s: float
    newest_file_s: float | None

    @classmethod
    def read(cls, state_dir: Path) -> "Machine":
        """Read it now."""
        with precedence():
            real_time = has_precedence()
        return cls(
            len(os.sched_getaffinity(0)),
            os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / _MIB,
            resource.getrlimit(resource.RLIMIT_NOFILE)[1],
            MemoryLimits.of_this_process(),
            real_time,
            _clock_is_synchronised(),
            time.time(),
            max(_times_of_files(state_dir), default=None),
        )


def machine_findings(machine: Machine) -> Iterator[Finding]:
    """Findings on the machine."""
    yield _processors(machine)
    yield _memory(machine)
    yield _handles(machine)
    yield _shared_memory(machine)
    yield _real_time(machine)
    yield _clock(machine)


def disk_finding(state_dir: Path, settings: ServiceSettings) -> Finding:
    """Whether the state folder's disk has space, by the rules of the services."""
    folder = next(one for one in (state_dir, *state_dir.resolve().parents) if one.is_dir())
    if not os.access(folder, os.W_OK):
        return wrong("disk", f"{folder} cannot be written", "give the services' user the folder, or choose another one")
    if (lack := lack_of_space(folder, settings)) is not None:
        measured, _, remedy = lack.partition("; ")
        return attention("disk", measured, remedy or "free space, or move the state folder")
    free = os.statvfs(folder)
    return well("disk", f"{free.f_bavail * free.f_frsize / 2**30:.0f} GiB free in {folder}")


def _processors(machine: Machine) -> Finding:
    found = f"{machine.processors} processors"
    if machine.processors < 2:
        return attention("processors", found, "give the installation two: with one, images wait for each other")
    return well("processors", found)


def _memory(machine: Machine) -> Finding:
    found = f"{machine.memory_mib:.0f} MiB of memory"
    if machine.memory_mib < _LEAST_MEMORY_MIB:
        return attention(
            "memory", f"{found} (at least {_LEAST_MEMORY_MIB:.0f})", "add memory, or run services elsewhere"
        )
    return well("memory", found)


def _handles(machine: Machine) -> Finding:
    unlimited = machine.handles == resource.RLIM_INFINITY
    found = "any number of handles" if unlimited else f"up to {machine.handles} handles"
    if unlimited or machine.handles >= _LEAST_HANDLES:
        return well("handles", found)
    remedy = "raise the hard limit (ulimit -Hn, LimitNOFILE of systemd): consoles and images need connections and files"
    return attention("handles", f"{found} (at least {_LEAST_HANDLES})", remedy)


def _shared_memory(machine: Machine) -> Finding:
    shortage = shared_memory_shortage(machine.locked)
    if shortage is None:
        pool_mib = pool_bytes(machine.locked) / 2**20
        return well("shared memory", f"frames go by shared memory, from a pool of {pool_mib:g} MiB")
    measured, _, remedy = shortage.partition("; ")
    return attention("shared memory", measured, remedy)


def _real_time(machine: Machine) -> Finding:
    if machine.real_time:
        return well("real time", "a stop goes before everything else on the processors")
    remedy = (
        "raise the limit RTPRIO to 1 (a line `distalock - rtprio 1` in /etc/security/limits.d, LimitRTPRIO of systemd)"
    )
    return attention("real time", "real-time scheduling is not allowed: a stop competes with what computes", remedy)


def _clock(machine: Machine) -> Finding:
    ahead_s = (machine.newest_file_s or 0.0) - machine.now_s
    if ahead_s > _CLOCK_BEHIND_S:
        found = f"the clock is {ahead_s:.0f} s behind the newest file of the state folder"
        return wrong("clock", found, "set the clock: it was set back, and records would be dated wrongly")
    if machine.synchronised is None:
        return unknown("clock", "the system does not say whether a time service runs")
    if not machine.synchronised:
        return attention("clock", "no time service keeps the clock right", "start one (chrony, systemd-timesyncd)")
    return well("clock", "kept right by a time service")


def _clock_is_synchronised() -> bool | None:
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))
    except (AttributeError, OSError):
        return None
    return None if state < 0 else bool(state != _NOT_SYNCHRONISED)


def _times_of_files(folder: Path) -> Iterator[float]:
    for pattern in ("*", "logs/*"):
        yield from (file.stat().st_mtime for file in folder.glob(pattern) if file.is_file())
