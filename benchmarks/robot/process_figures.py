"""What the processes of an installation take: memory, handles, threads, as Linux counts them."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_KIB_PER_MIB: Final = 1024.0


@dataclass(frozen=True, slots=True)
class ProcessFigures:
    """One process at one moment.

    Attributes
    ----------
    memory_mib
        Anonymous memory that is resident: what the process has allocated, without files and shared pixels.
    cpu_s
        Processor time since its start.
    """

    memory_mib: float
    handles: int
    threads: int
    cpu_s: float


def family(pids: Mapping[str, int]) -> dict[str, int]:
    """Processes and their descendants by name; a descendant is named after its module or its parent."""
    found: dict[str, int] = {}
    for name, pid in pids.items():
        found[name] = pid
        for child in descendants(pid):
            found[f"{name}: {_module_of(child)}"] = child
    return found


def descendants(pid: int) -> list[int]:
    """All processes below one."""
    children = [int(word) for file in Path(f"/proc/{pid}/task").glob("*/children") for word in file.read_text().split()]
    return [one for child in children for one in (child, *descendants(child))]


def figures_of(pid: int) -> ProcessFigures:
    """What a process takes now; raises `OSError` when it has ended."""
    status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines() if ":" in line)
    times = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    ticks = int(times[11]) + int(times[12])
    return ProcessFigures(
        memory_mib=float(status["RssAnon"].split()[0]) / _KIB_PER_MIB,
        handles=len(list(Path(f"/proc/{pid}/fd").iterdir())),
        threads=int(status["Threads"]),
        cpu_s=ticks / os.sysconf("SC_CLK_TCK"),
    )


def _module_of(pid: int) -> str:
    words = Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
    return words[words.index("-m") + 1].rpartition(".")[2] if "-m" in words else Path(words[0]).name
