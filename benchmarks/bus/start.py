"""Starts of `distalock up --simulate` with certificates beside starts without; writes docs/benchmarks/start.md.

usage: distalock bench start [--rounds 7]

Each round starts three installations one after the other, in an order that changes: without TLS, with certificates that
are made at this first start, and with certificates that are there. A start ends when the gateway reports itself ready.
"""

import os
import statistics
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
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
other, until the gateway reports itself ready. The order changes from round to round. Difference and ratio are medians
over the rounds of those within a round.

| start | median | shortest | longest | longer by | ratio |
|---|---|---|---|---|---|
"""


def main(arguments: Sequence[str] = ()) -> int:
    """Measure and write the page; 0 when starts with certificates take at most a second longer."""
    parser = OneLineParser(prog="distalock bench start", description="starts with certificates beside starts without")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"how often each is started ({ROUNDS})")
    given = parser.parse_args(list(arguments))
    seconds = measured(given.rounds)
    REPORT.write_text(page(seconds))
    print(page(seconds))
    return 0 if max(longer_s(seconds, kind) for kind in ("first", "later")) <= MOST_LONGER_S else 1


def measured(rounds: int) -> dict[Kind, list[float]]:
    """Seconds of each start, in the order of the rounds."""
    seconds: dict[Kind, list[float]] = {kind: [] for kind in KINDS}
    order = list(KINDS)
    with tempfile.TemporaryDirectory(prefix="distalock-start-") as folder:
        kept = Path(folder) / "later"
        start_s(kept, plain_bus=False)  # makes the certificates of later starts, and warms the disk's cache for all
        for number in range(rounds):
            for kind in order:
                state = kept if kind == "later" else Path(folder) / f"{kind}-{number}"
                seconds[kind].append(start_s(state, plain_bus=kind == "plain"))
            order.append(order.pop(0))
    return seconds


def start_s(state: Path, *, plain_bus: bool) -> float:
    """Start an installation with the virtual operating room, and stop it; how long it took to be ready."""
    installation = Installation(Ports.any_free(), state, plain_bus=plain_bus)
    began_s = time.monotonic()
    with installation.fleet(threading.Event(), start_patience_s=300.0):
        return time.monotonic() - began_s


def longer_s(seconds: Mapping[Kind, Sequence[float]], kind: Kind) -> float:
    """By how much a start is longer than without TLS: the median of the differences within a round."""
    return statistics.median(one - plain for one, plain in zip(seconds[kind], seconds["plain"], strict=True))


def page(seconds: Mapping[Kind, Sequence[float]]) -> str:
    """The report."""
    rows = "".join(_row(seconds, kind, label) for kind, label in KINDS.items())
    limit = f"| limit | | | | {MOST_LONGER_S:.2f} s | |\n"
    load = f"Load average of the five minutes before the end of this run: {os.getloadavg()[1]:.1f}, on {os.cpu_count()}"
    return f"{_HEAD.format(len(seconds['plain']))}{rows}{limit}\n{load} processors.\n"


def _row(seconds: Mapping[Kind, Sequence[float]], kind: Kind, label: str) -> str:
    own = seconds[kind]
    ratio = statistics.median(one / plain for one, plain in zip(own, seconds["plain"], strict=True))
    figures = " | ".join(f"{figure:.2f} s" for figure in (statistics.median(own), min(own), max(own)))
    return f"| {label} | {figures} | {longer_s(seconds, kind):+.2f} s | {ratio:.2f} |\n"
