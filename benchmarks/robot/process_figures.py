"""What the processes of an installation take, as Linux counts it, and how long the gateway's queues are."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from distalock.rest_client import RestClient

QUEUES: Final = ("inbox", "stop_record", "stops", "relays", "streams", "connections")
_METRIC: Final = re.compile(r'^distalock_(?:queued|front)\{(?:queue|figure)="(\w+)"\} ([\d.e+-]+)$', re.MULTILINE)
WARM_UP: Final = 0.25  # of the time
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


@dataclass(frozen=True, slots=True)
class Sample:
    """Everything at one moment; `at_s` counts from the load's beginning."""

    at_s: float
    processes: Mapping[str, ProcessFigures]
    queues: Mapping[str, float]

    @staticmethod
    def of(pids: Mapping[str, int], rest: RestClient, at_s: float) -> "Sample":
        """What processes and their descendants take now, and how long the gateway's queues are."""
        processes = {name: figures_of(pid) for name, pid in family(pids).items()}
        queues = {name: float(value) for name, value in _METRIC.findall(rest.get_bytes("/metrics").decode())}
        return Sample(at_s, processes, queues)


def settled(samples: Sequence[Sample]) -> list[Sample]:
    """Samples after the warm-up."""
    return [sample for sample in samples if sample.at_s >= WARM_UP * samples[-1].at_s]


def growth(samples: Sequence[Sample], name: str) -> float:
    """How much the memory of a process grew, from the median of the first third after the warm-up to the last."""
    values = [sample.processes[name].memory_mib for sample in settled(samples) if name in sample.processes]
    third = max(len(values) // 3, 1)
    return float(np.median(values[-third:]) / np.median(values[:third])) - 1.0


def process_table(samples: Sequence[Sample]) -> str:
    """A table of all processes: memory, handles, threads, and the share of a processor."""
    rows = "".join(_process_row(samples, name) for name in samples[-1].processes)
    return (
        "| process | memory after warm-up | at the end | growth | handles: most | at the end | threads: most "
        f"| at the end | processor |\n|---|---|---|---|---|---|---|---|---|\n{rows}"
    )


def _process_row(samples: Sequence[Sample], name: str) -> str:
    seen = [sample.processes[name] for sample in samples if name in sample.processes]
    first = next(s.processes[name] for s in settled(samples) if name in s.processes)
    last, span_s = seen[-1], max(samples[-1].at_s, 1.0)
    share = (last.cpu_s - seen[0].cpu_s) / span_s
    return (
        f"| {name} | {first.memory_mib:.1f} MiB | {last.memory_mib:.1f} MiB | {growth(samples, name):+.1%} "
        f"| {max(f.handles for f in seen)} | {last.handles} | {max(f.threads for f in seen)} | {last.threads} "
        f"| {share:.0%} |\n"
    )


def queue_table(samples: Sequence[Sample]) -> str:
    """A table of the gateway's queues: median after the warm-up, most, and at the end."""
    rows = "".join(
        f"| {name} | {np.median([s.queues.get(name, 0.0) for s in settled(samples)]):.0f} "
        f"| {max(s.queues.get(name, 0.0) for s in samples):.0f} | {samples[-1].queues.get(name, 0.0):.0f} |\n"
        for name in QUEUES
    )
    return f"| queue of the gateway | median | most | at the end |\n|---|---|---|---|\n{rows}"


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
