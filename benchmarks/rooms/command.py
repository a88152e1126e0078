"""Rooms at one site: whether a room notices another's flood or the site's loss, and what each room costs.

usage: distalock bench rooms [--rounds 12] [--seconds 3] [--most 16] [--report FILE]

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
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.common.places import PAGES
from benchmarks.rooms.figures import Disturbance, Figures, Growth
from benchmarks.rooms.hospital import Hospital, Latencies, Room, processor_s, resident_mib
from benchmarks.rooms.page import page
from shared.arguments import OneLineParser

REPORT: Final = PAGES / "rooms.md"
ROOMS: Final = ("or1", "or2", "or3")
# Room of a site of its own, which has the same floods on the same processor: what they do to a room's machine alone.
ELSEWHERE: Final = "elsewhere"
LIMIT: Final = 1.1
DELAY_S: Final = 0.02
LOSS: Final = 0.02
_PARTED_S: Final = 6.0
_SETTLE_S: Final = 1.0
_GROWTH_S: Final = 6.0


def main(arguments: Sequence[str] = ()) -> int:
    """Measure, write the page; 0 when every ratio holds."""
    parser = OneLineParser(prog="distalock bench rooms", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=12, help="rounds of each disturbance (12)")
    parser.add_argument("--seconds", type=float, default=3.0, help="of each half of a round (3)")
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
        # on the processor of everybody else, as this process is by now
        elsewhere = Hospital(folder / ELSEWHERE, (ELSEWHERE,), stack, own_cores=False)
        elsewhere.add_room(ELSEWHERE).network.delay_s = DELAY_S
        flooded = partial(_flooding_room, hospital), partial(_flooding_room, elsewhere)
        by_key = partial(_flooding_site, hospital), partial(_flooding_site, elsewhere)
        room = hospital.rooms[0]
        disturbances = [
            _disturbed(room, given, "another room floods its bus and the site", *flooded),
            _disturbed(room, given, "a stolen key of another room floods the site", *by_key),
            _disturbed(room, given, f"the site loses {LOSS:.0%} of the segments", partial(_lossy, hospital), _nothing),
            _disturbed(room, given, "the site is cut off", partial(_parted, hospital), _nothing),
        ]
        of_machine = _disturbed(
            room, given, "a room of another site floods its bus and that site", flooded[1], _nothing
        )
        seen_again_s = _seen_again_s(hospital)
    return Figures(disturbances, of_machine, seen_again_s, grown(given.most))


# Begins something, and returns what ends it.
Disturb = Callable[[], Callable[[], object]]


def _disturbed(room: Room, given: argparse.Namespace, name: str, disturb: Disturb, control: Disturb) -> Disturbance:
    """Rounds of the room, one half of each beside the control and the other beside the disturbance."""
    beside_control, beside_disturbance = list[Latencies](), list[Latencies]()
    for _ in range(given.rounds):
        for begin, found in ((control, beside_control), (disturb, beside_disturbance)):
            end = begin()
            time.sleep(_SETTLE_S)
            found.append(room.measure(given.seconds))
            end()
            time.sleep(_SETTLE_S)
    print(f"{name}: done", file=sys.stderr, flush=True)
    return Disturbance(name, beside_control, beside_disturbance)


def _nothing() -> Callable[[], object]:
    return lambda: None


def _flooding_room(hospital: Hospital) -> Callable[[], object]:
    hospital.rooms[-1].ask("flood on")
    return lambda: hospital.rooms[-1].ask("flood off")


def _flooding_site(hospital: Hospital) -> Callable[[], object]:
    return hospital.flood_site(hospital.rooms[-1].name).kill


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
