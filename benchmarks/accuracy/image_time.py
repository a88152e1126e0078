"""How long one image takes, stage by stage, on both cores and on one.

usage: distalock bench image_time [--count 12] [--report docs/benchmarks/image-time.md]

Random scenes, each localised several times in a row after once to warm up; a stage's time is the median over the
scenes of the median over the rounds. In turn with it runs OpenCV's search for circles of a ball's size on the same
image (which only looks for circles): a measure of the machine. For the column of one core the process is confined to
one, for the peer too. What is compiled on first use has been compiled.
"""

import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.baselines.methods import peer_seconds
from benchmarks.common.places import PAGES
from benchmarks.scenes.random_scenes import nominal_of, parts_of, scene_of_seed
from distalock.arguments import OneLineParser, whole_number, writable_file
from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from services.registration.core.localise import LocalisationStep, Parts, localise
from shared.errors import Accepted
from simulation.render.image import render_scene
from simulation.world.poses import starting_state

FIRST_SEED, SCENES, ROUNDS = 30_000, 12, 5
REPORT = PAGES / "image-time.md"
STAGES = ("ring and calibration", "guide", "nail", "axes and verdict", "whole image")


def stage_seconds(pixels: NDArray[np.float32], nominal: NominalGeometry, parts: Parts) -> NDArray[np.float64] | None:
    """Time of each of the `STAGES`, shape (5,); None when the image shows no ring."""
    ends: dict[LocalisationStep, float] = {}
    started = time.perf_counter()
    calibrated = calibrate_image(pixels, parts.ring, nominal)
    if not isinstance(calibrated, Accepted):
        return None
    calibrated_at = time.perf_counter()
    localise(pixels, calibrated.value, parts, lambda step: ends.update({step: time.perf_counter()}))
    instants = np.array(
        [started, calibrated_at, ends[LocalisationStep.GUIDE], ends[LocalisationStep.NAIL], time.perf_counter()]
    )
    return np.append(np.diff(instants), instants[-1] - started)


@contextmanager
def on_one_core() -> Iterator[None]:
    """Confine all threads of this process to one of its cores."""
    allowed = os.sched_getaffinity(0)
    _confine({min(allowed)})
    try:
        yield
    finally:
        _confine(allowed)


def _confine(cores: set[int]) -> None:
    for thread in Path("/proc/self/task").iterdir():
        with suppress(ProcessLookupError):  # it may have ended meanwhile
            os.sched_setaffinity(int(thread.name), cores)


def measured(seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64], float] | None:
    """Stages on all cores and on one, shape (5,) each, and the peer's seconds; None when the image shows no ring."""
    scenario = scene_of_seed(seed)
    pixels = render_scene(scenario, starting_state(scenario)).pixels.astype(np.float32)
    case = pixels, nominal_of(scenario), parts_of(scenario)
    if stage_seconds(*case) is None:
        return None
    both, one, peer = [], [], []
    for _ in range(ROUNDS):
        both.append(stage_seconds(*case))
        with on_one_core():
            one.append(stage_seconds(*case))
            peer.append(peer_seconds(pixels))
    of_all, of_one = (np.median(np.array(rounds, dtype=np.float64), axis=0) for rounds in (both, one))
    return of_all, of_one, float(np.median(peer))


def report(both: NDArray[np.float64], one: NDArray[np.float64], peer: NDArray[np.float64]) -> str:
    """The table, from seconds of shape (scenes, 5) twice and (scenes,)."""
    cores = len(os.sched_getaffinity(0))
    lines = [
        f"{len(both)} scenes of 1024 x 1024 pixels, {ROUNDS} rounds each.",
        "",
        f"| median | {cores} cores, ms | one core, ms | one core, of HoughCircles |",
        "|---|---|---|---|",
    ]
    for stage, name in enumerate(STAGES):
        times = (1e3 * np.median(both[:, stage]), 1e3 * np.median(one[:, stage]))
        lines.append(f"| {name} | {times[0]:.0f} | {times[1]:.0f} | {np.median(one[:, stage] / peer):.1f} |")
    lines.append(f"| HoughCircles | | {1e3 * np.median(peer):.0f} | 1 |")
    quickest, slowest = 1e3 * np.percentile(both[:, -1], [0, 95])
    gain = np.median(one[:, -1] / both[:, -1])
    lines.append(
        f"\nWhole images on {cores} cores took from {quickest:.0f} ms to {slowest:.0f} ms (95 %); one core took "
        f"{gain:.2f} times as long."
    )
    return "\n".join(lines)


def main(arguments: Sequence[str] = ()) -> int:
    """Measure, print the table, and write the page."""
    parser = OneLineParser(prog="distalock bench image_time", description="time of one image, stage by stage")
    parser.add_argument(
        "--count",
        type=whole_number("a number of scenes", 1, 10**4),
        default=SCENES,
        help=f"number of scenes ({SCENES})",
    )
    parser.add_argument("--report", type=writable_file, default=REPORT, help="file for the table")
    given = parser.parse_args(list(arguments))
    rows = []
    for seed in range(FIRST_SEED, FIRST_SEED + given.count):
        row = measured(seed)
        print(f"{seed}: {'no ring' if row is None else f'{1e3 * row[0][-1]:.0f} ms'}", file=sys.stderr, flush=True)
        rows += [] if row is None else [row]
    if not rows:
        print("distalock bench image_time: no scene shows a ring; take more scenes (--count)", file=sys.stderr)
        return 1
    text = report(*(np.array(part) for part in zip(*rows, strict=True)))
    print(text)
    about = (__doc__ or "").split("\n", 4)[4].strip()
    given.report.write_text(f"# Time of one image\n\nMade by `distalock bench image_time`. {about}\n\n{text}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
