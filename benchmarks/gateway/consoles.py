"""Fifty consoles that watch, and one that is stuck: motion, stop and the gateway's memory beside those without.

usage: distalock bench consoles [--trials 200] [--blocks 8] [--consoles 50] [--report FILE]

Real processes of router, gateway and robot service, and a virtual controller in this process that notes when a command
arrives. A console watches the live picture (30 images of 2 MB a second on the bus) and the events; the stuck one asks
for both and reads nothing. Blocks with consoles and without take turns. A motion is timed from `POST .../motions` to
its command at the controller, and a stop, somewhere in that motion, from `POST /robot/stop` to its byte.
"""

import argparse
import os
import random
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from benchmarks.common.places import PAGES
from benchmarks.gateway.planned_motions import PlannedMotions
from benchmarks.robot.loads import ClientsOfAll, clients
from benchmarks.robot.process_figures import family, figures_of
from benchmarks.robot.stop_latency_rig import StopRig, stop_rig
from distalock.arguments import whole_number, writable_file
from shared.arguments import OneLineParser

REPORT: Final = PAGES / "consoles.md"
TRIALS: Final = 200
BLOCKS: Final = 8
CONSOLES: Final = 50
LARGEST_RATIO: Final = 1.2
# Of each block's first samples: whatever is made once, for the first consoles, is no growth.
LARGEST_GROWTH: Final = 0.05
_SEED: Final = 81
_QUANTILES: Final = (50.0, 95.0)


@dataclass(slots=True)
class Measured:
    """Seconds of motions and stops, and the gateway's memory in MiB, without consoles or with them."""

    motions_s: list[float] = field(default_factory=list)
    stops_s: list[float] = field(default_factory=list)
    memory_mib: list[list[float]] = field(default_factory=list)
    received: list[Mapping[str, int]] = field(default_factory=list)
    seconds: float = 0.0

    def block(self, motions: PlannedMotions, source: random.Random, trials: int) -> None:
        """Some trials, and what the gateway takes meanwhile."""
        began_s, memory_mib = time.monotonic(), list[float]()
        for _ in range(trials):
            self.motions_s.append(motions.motion_latency_s(source))
            self.stops_s.append(motions.rig.stopped_within_s(source))
            memory_mib.append(gateway_memory_mib(motions.rig))
        self.memory_mib.append(memory_mib)
        self.seconds += time.monotonic() - began_s

    @property
    def growth(self) -> float:
        """From the median of the first third of a block to that of its last, at most."""
        return max(_growth(one) for one in self.memory_mib)


@dataclass(frozen=True, slots=True)
class Compared:
    """Both.

    Attributes
    ----------
    not_begun
        Motions that did not begin, by the reason that their operation gives.
    """

    without: Measured
    watched: Measured
    not_begun: Mapping[str, int] = field(default_factory=dict)

    def ratio(self, of: Callable[[Measured], list[float]], percent: float) -> float:
        """Of a quantile."""
        return float(np.percentile(of(self.watched), percent) / np.percentile(of(self.without), percent))

    @property
    def holds(self) -> bool:
        """Whether the limits hold: of the medians, and of memory."""
        ratios = [self.ratio(of, 50.0) for of in (_motions, _stops)]
        return max(ratios) <= LARGEST_RATIO and self.watched.growth <= LARGEST_GROWTH


def gateway_memory_mib(rig: StopRig) -> float:
    """Anonymous resident memory of front and application together."""
    pids = {"ui_api": rig.pids["ui_api"]}
    return sum(figures_of(pid).memory_mib for pid in family(pids).values())


def compare(rig: StopRig, trials: int, blocks: int, consoles: int) -> Compared:
    """Blocks in turn."""
    source, found, motions = random.Random(_SEED), Compared(Measured(), Measured()), PlannedMotions(rig)
    everybody = ClientsOfAll(viewers=consoles, events=consoles, idle=0, stuck=1, of_case=False)
    Measured().block(motions, source, 2)  # what is loaded with the first motion
    for _ in range(blocks):
        found.without.block(motions, source, trials // blocks)
        with clients(rig, everybody) as received:
            found.watched.block(motions, source, trials // blocks)
        found.watched.received.append(received)
    return replace(found, not_begun=dict(motions.not_begun))


def main(arguments: Sequence[str] = ()) -> int:
    """Measure, write the page; 1 when a limit does not hold."""
    given = _options(arguments)
    with stop_rig() as rig:
        found = compare(rig, given.trials, given.blocks, given.consoles)
    page = page_of(found, given.consoles)
    given.report.write_text(page)
    print(page)
    return 0 if found.holds else 1


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = OneLineParser(prog="distalock bench consoles", description="consoles that watch, and one that is stuck")
    count = whole_number("a number", 1, 10**4)
    parser.add_argument("--trials", type=count, default=TRIALS, help=f"motions, and stops, of each sort ({TRIALS})")
    parser.add_argument("--blocks", type=count, default=BLOCKS, help=f"in which they are made ({BLOCKS})")
    parser.add_argument("--consoles", type=count, default=CONSOLES, help=f"that watch ({CONSOLES})")
    parser.add_argument("--report", type=writable_file, default=REPORT, help="file for the page")
    return parser.parse_args(list(arguments))


def _motions(measured: Measured) -> list[float]:
    return measured.motions_s


def _stops(measured: Measured) -> list[float]:
    return measured.stops_s


def _growth(memory_mib: Sequence[float]) -> float:
    third = max(len(memory_mib) // 3, 1)
    return float(np.median(memory_mib[-third:]) / np.median(memory_mib[:third])) - 1.0


def page_of(found: Compared, consoles: int) -> str:
    """The page."""
    watched = found.watched
    pictures = sum(one.get("pictures", 0) for one in watched.received) / consoles / watched.seconds
    frames = sum(one.get("frames", 0) for one in watched.received) / watched.seconds
    events = sum(one.get("events", 0) for one in watched.received) / consoles / watched.seconds
    again = sum(one.get("viewers closed", 0) + one.get("events closed", 0) for one in watched.received)
    rows = "".join(_row(name, of, found) for name, of in (("motion", _motions), ("stop", _stops)))
    most = [max(value for one in part.memory_mib for value in one) for part in (found.without, watched)]
    return (
        "# Consoles that watch, and one that is stuck\n\n"
        f"Made by `distalock bench consoles`: {len(found.without.motions_s)} motions, each stopped on its way, without "
        f"and as many while {consoles} consoles\nwatch the live picture and the events, and one more asks for "
        "both and reads nothing; in blocks that take turns. Real processes of router,\ngateway and robot service. A "
        "motion is timed from `POST .../motions` to its command at the controller, a stop from `POST /robot/stop` to\n"
        "its byte. The images belong to no case: with each image of its case a plan would be stale.\n\n"
        "| | without: median | 95 % | watched: median | 95 % | ratio of medians | of 95 % |\n"
        "|---|---|---|---|---|---|---|\n"
        f"{rows}| limit | | | | | {LARGEST_RATIO:g} | |\n\n"
        "| memory of the gateway (front and application) | most | growth within a block |\n|---|---|---|\n"
        f"| without | {most[0]:.0f} MiB | {found.without.growth:+.1%} |\n"
        f"| watched | {most[1]:.0f} MiB | {watched.growth:+.1%} (limit {LARGEST_GROWTH:.0%}) |\n\n"
        f"Meanwhile {frames:.0f} images/s were published; each console received {pictures:.1f} pictures/s and "
        f"{events:.0f} events/s, and {again} of their connections\nwere closed; "
        f"{sum(found.not_begun.values())} motions did not begin. The consoles run on the same machine, at nice 19.\n\n"
        f"{''.join(f'- {count} times: {why}' + chr(10) for why, count in found.not_begun.items())}"
        f"Load average of the five minutes before the end of this run: {os.getloadavg()[1]:.1f}, "
        f"on {os.cpu_count()} processors.\n"
    )


def _row(name: str, of: Callable[[Measured], list[float]], found: Compared) -> str:
    figures = " | ".join(
        f"{1e3 * np.percentile(of(part), percent):.1f} ms"
        for part in (found.without, found.watched)
        for percent in _QUANTILES
    )
    return f"| {name} | {figures} | {found.ratio(of, 50.0):.2f} | {found.ratio(of, 95.0):.2f} |\n"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
