"""Starts of `distalock up --simulate` with certificates beside starts without; writes docs/benchmarks/start.md.

usage: distalock bench start [--rounds 7]

Each round starts three installations one after the other, in an order that changes: without TLS, with certificates that
are made at this first start, and with certificates that are there. A start ends when the gateway reports itself ready.
"""

import os
import resource
import statistics
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from benchmarks.common.places import PAGES
from distalock.installation import Installation, Ports
from shared.arguments import OneLineParser

REPORT: Final = PAGES / "start.md"
MOST_LONGER_S: Final = 1.0
ROUNDS: Final = 7
Kind = Literal["plain", "first", "later"]
KINDS: Final[Mapping[Kind, str]] = {
    "plain": "without TLS (`--plain-bus`)",
    "first": "the first start: all certificates are made",
    "later": "a later start: certificates are there",
}
_HEAD: Final = """# Starts with certificates beside starts without

Made by `distalock bench start`: {} rounds of three starts of `distalock up --simulate` one after the
other, until the gateway reports itself ready. The order changes from round to round. Differences and the ratio are
medians over the rounds of those within a round. Processor time is that of all processes, their end included.

| start | median | shortest | longest | longer by | ratio | processor time | more by |
|---|---|---|---|---|---|---|---|
"""


@dataclass(frozen=True, slots=True)
class Start:
    """One start.

    Attributes
    ----------
    ready_s
        Until the gateway reported itself ready.
    processor_s
        Processor time of all processes, their end included: other programs on the machine change it little.
    """

    ready_s: float
    processor_s: float


Starts = Mapping[Kind, Sequence[Start]]


def main(arguments: Sequence[str] = ()) -> int:
    """Measure and write the page; 0 when starts with certificates take at most a second longer."""
    parser = OneLineParser(prog="distalock bench start", description="starts with certificates beside starts without")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"how often each is started ({ROUNDS})")
    given = parser.parse_args(list(arguments))
    starts = measured(given.rounds)
    REPORT.write_text(page(starts))
    print(page(starts))
    return 0 if max(longer_s(starts, kind) for kind in ("first", "later")) <= MOST_LONGER_S else 1


def measured(rounds: int) -> dict[Kind, list[Start]]:
    """Each start, in the order of the rounds."""
    starts: dict[Kind, list[Start]] = {kind: [] for kind in KINDS}
    order = list(KINDS)
    with tempfile.TemporaryDirectory(prefix="distalock-start-") as folder:
        kept = Path(folder) / "later"
        started(kept, plain_bus=False)  # makes the certificates of later starts, and warms the disk's cache for all
        for number in range(rounds):
            for kind in order:
                state = kept if kind == "later" else Path(folder) / f"{kind}-{number}"
                starts[kind].append(started(state, plain_bus=kind == "plain"))
            order.append(order.pop(0))
    return starts


def started(state: Path, *, plain_bus: bool) -> Start:
    """Start an installation with the virtual operating room, and stop it."""
    installation = Installation(Ports.any_free(), state, plain_bus=plain_bus)
    began_s, used_s = time.monotonic(), _processor_s()
    with installation.fleet(threading.Event(), start_patience_s=300.0):
        ready_s = time.monotonic() - began_s
    return Start(ready_s, _processor_s() - used_s)


def _processor_s() -> float:
    """Of this process, which makes the keys, and of its processes that have ended."""
    used = (resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in used)


def longer_s(starts: Starts, kind: Kind) -> float:
    """By how much a start is longer than without TLS: the median of the differences within a round."""
    pairs = zip(starts[kind], starts["plain"], strict=True)
    return statistics.median(one.ready_s - plain.ready_s for one, plain in pairs)


def page(starts: Starts) -> str:
    """The report."""
    rows = "".join(_row(starts, kind, label) for kind, label in KINDS.items())
    limit = f"| limit | | | | {MOST_LONGER_S:.2f} s | | | |\n"
    load = f"Load average of the five minutes before the end of this run: {os.getloadavg()[1]:.1f}, on {os.cpu_count()}"
    return f"{_HEAD.format(len(starts['plain']))}{rows}{limit}\n{load} processors.\n"


def _row(starts: Starts, kind: Kind, label: str) -> str:
    pairs = list(zip(starts[kind], starts["plain"], strict=True))
    own = [one.ready_s for one in starts[kind]]
    used = statistics.median(one.processor_s for one in starts[kind])
    ratio = statistics.median(one.ready_s / plain.ready_s for one, plain in pairs)
    more = statistics.median(one.processor_s - plain.processor_s for one, plain in pairs)
    figures = " | ".join(f"{figure:.2f} s" for figure in (statistics.median(own), min(own), max(own)))
    return f"| {label} | {figures} | {longer_s(starts, kind):+.2f} s | {ratio:.2f} | {used:.2f} s | {more:+.2f} s |\n"
