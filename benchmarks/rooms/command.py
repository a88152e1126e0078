"""Rooms at one site: whether a room notices another's flood or the site's loss, and what each room costs.

usage: distalock bench rooms [--rounds 8] [--seconds 4] [--most 16] [--report FILE]

Three rooms, each with a router, an exporter and light services (the messages of the services, without their work), show
themselves to a site router under mutual TLS, over a relay that delays, loses and parts. The measured room has a
processor of its own, as it has a machine of its own in a hospital; everything else shares the others.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.common.places import PAGES
from benchmarks.rooms.figures import Disturbance, Figures, Growth
from benchmarks.rooms.hospital import Hospital, Latencies, processor_s, resident_mib
from benchmarks.rooms.page import page
from shared.arguments import OneLineParser

REPORT: Final = PAGES / "rooms.md"
ROOMS: Final = ("or1", "or2", "or3")
LIMIT: Final = 1.1
DELAY_S: Final = 0.02
LOSS: Final = 0.02
_PARTED_S: Final = 6.0
_SETTLE_S: Final = 1.0
_GROWTH_S: Final = 6.0


def main(arguments: Sequence[str] = ()) -> int:
    """Measure, write the page; 0 when every ratio holds."""
    parser = OneLineParser(prog="distalock bench rooms", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=8, help="rounds of each disturbance (8)")
    parser.add_argument("--seconds", type=float, default=4.0, help="of each half of a round (4)")
    parser.add_argument("--most", type=int, default=16, help="rooms at one site in the end (16)")
    parser.add_argument("--report", type=Path, default=REPORT, help="file for the page")
    given = parser.parse_args(list(arguments))
    figures = measured(given)
    text = page(figures, LIMIT)
    print(text)
    given.report.write_text(text, encoding="utf-8")
    held = all(one.ratio(kind) <= LIMIT for one in figures.disturbances for kind in ("stop", "command", "state"))
    return 0 if held else 1


def measured(given: argparse.Namespace) -> Figures:
    """Disturbances of three rooms with processors of their own, then growth."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        hospital = Hospital(folder, ROOMS, stack, own_cores=len(os.sched_getaffinity(0)) > 1)
        for name in ROOMS:
            room = hospital.add_room(name)
            room.network.delay_s = DELAY_S
        disturbances = [
            _disturbed(hospital, given, "another room floods its bus and the site", _flooding_room),
            _disturbed(hospital, given, "a stolen key of another room floods the site", _flooding_site),
            _disturbed(hospital, given, f"the site loses {LOSS:.0%} of the segments", _lossy),
            _disturbed(hospital, given, "the site is cut off", _parted),
        ]
        seen_again_s = _seen_again_s(hospital)
    return Figures(disturbances, seen_again_s, grown(given.most))


Disturb = Callable[[Hospital], Callable[[], object]]


def _disturbed(hospital: Hospital, given: argparse.Namespace, name: str, disturb: Disturb) -> Disturbance:
    quiet, disturbed, room = list[Latencies](), list[Latencies](), hospital.rooms[0]
    for _ in range(given.rounds):
        quiet.append(room.measure(given.seconds))
        end = disturb(hospital)
        time.sleep(_SETTLE_S)
        disturbed.append(room.measure(given.seconds))
        end()
        time.sleep(_SETTLE_S)
    print(f"{name}: done", file=sys.stderr, flush=True)
    return Disturbance(name, quiet, disturbed)


def _flooding_room(hospital: Hospital) -> Callable[[], object]:
    hospital.rooms[1].ask("flood on")
    return lambda: hospital.rooms[1].ask("flood off")


def _flooding_site(hospital: Hospital) -> Callable[[], object]:
    return hospital.flood_site(ROOMS[1]).kill


def _lossy(hospital: Hospital) -> Callable[[], object]:
    network = hospital.rooms[0].network
    network.loss = LOSS
    return lambda: setattr(network, "loss", 0.0)


def _parted(hospital: Hospital) -> Callable[[], object]:
    hospital.rooms[0].network.part()
    return hospital.rooms[0].network.mend


def _seen_again_s(hospital: Hospital) -> float:
    """From the end of a partition until the desk sees the room again."""
    hospital.rooms[0].network.part()
    time.sleep(_PARTED_S)
    hospital.rooms[0].network.mend()
    return hospital.wait_until_seen(ROOMS[0])


def grown(most: int) -> list[Growth]:
    """From one room to many, at one site, on all processors."""
    found, names = [], tuple(f"or{number + 1}" for number in range(most))
    with ExitStack() as stack:
        hospital = Hospital(Path(stack.enter_context(tempfile.TemporaryDirectory())), names, stack, own_cores=False)
        for name in names:
            hospital.add_room(name)
            count = len(hospital.rooms)
            if count & (count - 1) == 0 or count == most:  # powers of two
                found.append(_growth(hospital))
                print(f"{count} rooms: done", file=sys.stderr, flush=True)
    return found


def _growth(hospital: Hospital) -> Growth:
    rooms = hospital.rooms
    exporters = [room.processes[2].pid for room in rooms]
    hospital.desk.late_s.clear()
    carried, site_s = sum(room.network.carried_bytes for room in rooms), processor_s(hospital.router.pid)
    exporters_s = sum(map(processor_s, exporters))
    time.sleep(_GROWTH_S)
    late_s = hospital.desk.late_s or [float("nan")]
    memory = np.mean([room.resident_mib() for room in rooms], axis=0)
    return Growth(
        rooms=len(rooms),
        site_mib=resident_mib(hospital.router.pid),
        router_mib=float(memory[0]),
        exporter_mib=float(memory[1]),
        site_share=(processor_s(hospital.router.pid) - site_s) / _GROWTH_S,
        exporter_share=(sum(map(processor_s, exporters)) - exporters_s) / _GROWTH_S / len(rooms),
        bytes_per_s=(sum(room.network.carried_bytes for room in rooms) - carried) / _GROWTH_S / len(rooms),
        late_s=(float(np.median(late_s)), float(np.percentile(late_s, 99))),
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
