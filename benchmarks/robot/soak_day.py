"""A day of an operating room on a whole installation; writes docs/benchmarks/soak-day.md.

usage: distalock bench soak_day [--procedures 48] [--seed 2] [--report FILE]

Procedure after procedure with all services and the virtual room, each with four seconds of fluoroscopy at 30 images/s,
and stops when it has ended. A day of eight hours has one every ten minutes; the time between them is left out, for the
services then only send their heartbeats. After each procedure memory, handles and threads of each process, the queues
of the gateway and the sizes of what is kept are noted.
"""

import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from benchmarks.common.operating_room import OperatingRoom, running
from benchmarks.common.places import PAGES
from benchmarks.robot.process_figures import Sample, growth, process_table, queue_table, settled
from distalock.arguments import seed_number, whole_number, writable_file
from distalock.installation import Installation, Ports
from distalock.procedure import Ending, Procedure
from shared.arguments import OneLineParser
from shared.errors import DistalockError

REPORT: Final = PAGES / "soak-day.md"
PROCEDURES: Final = 48
SEED: Final = 2
HOURS_EACH: Final = 1.0 / 6.0
LIMIT_GROWTH_AN_HOUR: Final = 0.01
LIMIT_STOP_RATIO: Final = 1.5
_VIRTUAL_ROOM: Final = "virtual-or"
_STOPS: Final = 10
_FLUOROSCOPY: Final = {"images": 120, "images_per_s": 30.0, "places": 4, "about_image_x_deg": 1.0}
# Where the guide was mounted for each patient, from where the scenario has it, along each axis of the base.
_MOUNT_SD_MM: Final = 1.0
_BYTES_PER_MB: Final = 1e6


@dataclass(frozen=True, slots=True)
class Played:
    """One procedure, and the installation after it.

    Attributes
    ----------
    ending
        How it ended; with the sentence where it was not drilled.
    stop_s
        From the request of a stop to its answer, each.
    kept_mb
        Sizes of what the installation keeps, by name.
    """

    ending: str
    stop_s: tuple[float, ...]
    sample: Sample
    kept_mb: Mapping[str, float]


def main(arguments: Sequence[str]) -> int:
    """Play, write the page; 0 when all holes were drilled and nothing grew beyond its limit."""
    parser = OneLineParser(prog="distalock bench soak_day", description="procedures of eight hours, one after another")
    count = whole_number("procedures", 4, 10**4)
    parser.add_argument("--procedures", type=count, default=PROCEDURES, help=f"how many ({PROCEDURES})")
    parser.add_argument("--seed", type=seed_number, default=SEED, help=f"of the virtual room and its mounts ({SEED})")
    parser.add_argument("--report", type=writable_file, default=REPORT, help="file for the page")
    given = parser.parse_args(list(arguments))
    played: list[Played] = []
    for one in day(given.procedures, given.seed):
        played.append(one)
        memory = ", ".join(f"{name} {f.memory_mib:.0f}" for name, f in one.sample.processes.items() if ":" not in name)
        print(f"{len(played)}: {one.ending}; MiB: {memory}", flush=True)
    plot = given.report.with_suffix(".png")
    _write_plot(played, plot)
    text = page(played, plot.name)
    given.report.write_text(text, encoding="utf-8")
    print(text)
    return int(bool(failures(played)))


def day(procedures: int, seed: int) -> Iterator[Played]:
    """Play procedures on an installation of its own."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory(prefix="distalock-day-") as folder:
        installation = Installation(Ports.any_free(), Path(folder), scenario_arguments=("--seed", str(seed)))
        with running(installation) as room:
            began_s = time.monotonic()
            for _ in range(procedures):
                mount = rng.normal(0.0, _MOUNT_SD_MM, 3)
                ending = _procedure(room, mount)
                stops = tuple(_stop_s(room) for _ in range(_STOPS))
                sample = Sample.of(room.fleet.pids, room.rest, time.monotonic() - began_s)
                yield Played(ending, stops, sample, kept_mb(Path(folder)))


def _procedure(room: OperatingRoom, mount_mm: np.ndarray) -> str:
    """Mount, open a case, look on while the C-arm turns, and lead the case to its end."""
    room.control.delete("/faults")
    room.control.post("/faults", {"kind": "mount_shift", "shift_mm": mount_mm.tolist()})
    room.room.remove_wires()
    room.control.delete("/drills")
    case = room.open_case()
    try:
        room.control.post("/fluoroscopy", _FLUOROSCOPY)
        outcome = Procedure(case, room.room, room.room.scenario().hole_ids, lambda _: None).run()
    except (DistalockError, TimeoutError) as error:
        return f"{type(error).__name__}: {error}"
    finally:
        case.abandon("the procedure ends here")
    return str(outcome.ending) if outcome.ending is Ending.DRILLED else f"{outcome.ending}: {outcome.why}"


def _stop_s(room: OperatingRoom) -> float:
    began_s = time.monotonic()
    room.gateway.stop_robot()
    return time.monotonic() - began_s


def kept_mb(folder: Path) -> dict[str, float]:
    """Sizes in MB of what lies in the folder of an installation's state: the record, and each folder."""
    sizes: dict[str, float] = {}
    for file in (one for one in folder.rglob("*") if one.is_file()):
        place = file.relative_to(folder).parts
        name = place[0] if len(place) > 1 else "record" if ".db" in file.name or "sqlite" in file.name else "other"
        sizes[name] = sizes.get(name, 0.0) + file.stat().st_size / _BYTES_PER_MB
    return sizes


def growth_an_hour(samples: Sequence[Sample], name: str) -> float:
    """Growth of a process's memory in an hour of the day that is played."""
    # From the middle of the first third after the warm-up to the middle of the last.
    hours = len(settled(samples)) * HOURS_EACH * 2.0 / 3.0
    return growth(samples, name) / hours


def _of_the_product(samples: Sequence[Sample]) -> list[str]:
    """Names of the processes but for the virtual room, which stands for hardware."""
    return [name for name in samples[-1].processes if not name.startswith(_VIRTUAL_ROOM)]


def failures(played: Sequence[Played]) -> list[str]:
    """What did not hold."""
    samples = [one.sample for one in played]
    wrong = [f"procedure {n}: {one.ending}" for n, one in enumerate(played, 1) if one.ending != Ending.DRILLED]
    grown = {name: growth_an_hour(samples, name) for name in _of_the_product(samples)}
    limit = LIMIT_GROWTH_AN_HOUR
    wrong += [f"{name} grew by {by:.2%} an hour (limit {limit:.0%})" for name, by in grown.items() if by > limit]
    first, last = stop_p99_ms(played)
    if last > LIMIT_STOP_RATIO * first:
        wrong.append(f"99 % of stops within {last:.1f} ms at the end, {first:.1f} before (limit {LIMIT_STOP_RATIO:g})")
    return wrong


def stop_p99_ms(played: Sequence[Played]) -> tuple[float, float]:
    """99 % of stops of the first and of the last third."""
    third = max(len(played) // 3, 1)
    first, last = ([s for one in part for s in one.stop_s] for part in (played[:third], played[-third:]))
    return 1e3 * float(np.percentile(first, 99.0)), 1e3 * float(np.percentile(last, 99.0))


def _write_plot(played: Sequence[Played], file: Path) -> None:
    mpl.use("Agg")
    mpl.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    figure = Figure(figsize=(10.5, 3.8), layout="constrained")
    memory, kept, stops = figure.subplots(1, 3)
    hours = HOURS_EACH * np.arange(1, len(played) + 1)
    for name in played[-1].sample.processes:
        memory.plot(hours, [_memory_mib(one, name) for one in played], label=name)
    for name in played[-1].kept_mb:
        kept.plot(hours, [one.kept_mb.get(name, 0.0) for one in played], label=name)
    stops.plot(hours, [1e3 * np.median(one.stop_s) for one in played], label="median of ten")
    stops.plot(hours, [1e3 * max(one.stop_s) for one in played], label="longest of ten")
    for axes, unit in ((memory, "memory, MiB"), (kept, "kept, MB"), (stops, "stop, request to answer, ms")):
        axes.set(xlabel="hours of the day", ylabel=unit)
        axes.set_ylim(bottom=0.0)
        axes.legend(frameon=False, fontsize=7)
    figure.savefig(file, dpi=110, metadata={"Software": None})


def _memory_mib(one: Played, name: str) -> float:
    return one.sample.processes[name].memory_mib if name in one.sample.processes else np.nan


def page(played: Sequence[Played], plot: str) -> str:
    """The page."""
    samples, wrong = [one.sample for one in played], failures(played)
    drilled = sum(one.ending == Ending.DRILLED for one in played)
    first, last = stop_p99_ms(played)
    growths = "".join(f"| {name} | {growth_an_hour(samples, name):+.2%} |\n" for name in _of_the_product(samples))
    kept = "".join(
        f"| {name} | {played[0].kept_mb.get(name, 0.0):.1f} MB | {size:.1f} MB |\n"
        for name, size in played[-1].kept_mb.items()
    )
    held = "Everything held." if not wrong else "Not held: " + "; ".join(wrong) + "."
    return f"""# A day of an operating room

Made by `distalock bench soak_day --procedures {len(played)}`: {len(played)} procedures one after another on a whole
installation with the virtual room, each with {_FLUOROSCOPY["images"]} images of fluoroscopy at
{_FLUOROSCOPY["images_per_s"]:g} images/s, which counts as {len(played) * HOURS_EACH:.1f} hours with one every
{60 * HOURS_EACH:g} minutes; they took {samples[-1].at_s / 60:.0f} minutes. The time between procedures is left out.
Memory is anonymous resident memory after each procedure. All clients at once for an hour of real time: [soak](soak.md).

{drilled} of {len(played)} procedures drilled both holes. {held}

![memory, what is kept, and stops over the day]({plot})

| process | growth of memory an hour (limit {LIMIT_GROWTH_AN_HOUR:.0%}) |
|---|---|
{growths}
{process_table(samples)}
{queue_table(samples)}
| kept | after the first procedure | at the end |
|---|---|---|
{kept}
99 % of stops, from the request to its answer: {first:.1f} ms in the first third, {last:.1f} ms in the last
(limit {LIMIT_STOP_RATIO:g} times).
"""


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
