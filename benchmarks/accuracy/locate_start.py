"""`distalock locate` as a process of its own, beside a localisation in a process that has started already.

usage: distalock bench locate_start [--count 7] [--seed 30000] [--report FILE]

Both are timed in turn on the same rendered image, so that other work on the machine slows both down alike. The page,
docs/benchmarks/locate-start.md, gives medians and their ratio, and how long bad arguments take to be refused, in units
of the time of `python -c pass`. It times the imports of the libraries alone, too: what no change of this project's own
code can save.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import cv2

from benchmarks.common.places import PAGES
from benchmarks.scenes.random_scenes import catalogue_scene_of_seed
from distalock.arguments import OneLineParser, seed_number, whole_number, writable_file
from distalock.locate import locate_image, read_parts
from shared.parts.catalogue import FOLDER
from simulation.render.image import render_scene
from simulation.world.poses import starting_state

REPORT = PAGES / "locate-start.md"
SEED, COUNT = 30_000, 7
LARGEST_RATIO = 1.5
# What localisation imports, as far as it uses it.
_LIBRARIES = (
    "import cv2, numba, numpy, pydantic, scipy.linalg, scipy.ndimage, scipy.optimize, scipy.spatial.transform, "
    "scipy.special"
)


@dataclass(frozen=True, slots=True)
class Times:
    """Medians, in seconds of wall time."""

    cold_s: float
    warm_s: float
    libraries_s: float
    refused_s: float
    nothing_s: float
    count: int

    @property
    def ratio(self) -> float:
        """Cold process over warm localisation."""
        return self.cold_s / self.warm_s


def main(arguments: Sequence[str] = ()) -> int:
    """Time both and write the page; 1 when the ratio is above its limit."""
    given = _options(arguments)
    times = measured_times(given.seed, given.count)
    page = page_of(times)
    given.report.write_text(page)
    print(page)
    return 0 if times.ratio <= LARGEST_RATIO else 1


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = OneLineParser(prog="distalock bench locate_start", description="cold process and warm localisation")
    parser.add_argument(
        "--count", type=whole_number("a number of runs", 3, 1000), default=COUNT, help=f"runs of each ({COUNT})"
    )
    parser.add_argument("--seed", type=seed_number, default=SEED, help=f"seed of the scene ({SEED})")
    parser.add_argument("--report", type=writable_file, default=REPORT, help="file for the page")
    return parser.parse_args(list(arguments))


def measured_times(seed: int, count: int) -> Times:
    """Time everything on the scene of a seed, with parts of the catalogue."""
    scenario = catalogue_scene_of_seed(seed)
    sources = scenario.sources
    names = [source.name for source in (sources.ring, sources.guide, sources.nail)]
    command = [sys.executable, "-m", "distalock", "locate"]
    with tempfile.TemporaryDirectory() as folder:
        image = Path(folder) / "image.png"
        cv2.imwrite(str(image), render_scene(scenario, starting_state(scenario)).pixels)
        words = [
            word for kind, name in zip(("ring", "guide", "nail"), names, strict=True) for word in (f"--{kind}", name)
        ]
        ring, guide, nail = (FOLDER / f"{name}.json" for name in names)
        parts = read_parts(ring, guide, nail)
        rows = timed_in_turn(
            (
                lambda: _ended([*command, str(image), *words]),
                lambda: locate_image(image, parts),
                lambda: _ended([sys.executable, "-c", _LIBRARIES]),
                lambda: _ended([*command, "--nope"]),
                lambda: _ended([sys.executable, "-c", "pass"]),
            ),
            count,
        )
    cold_s, warm_s, libraries_s, refused_s, nothing_s = map(median, rows)
    return Times(cold_s, warm_s, libraries_s, refused_s, nothing_s, count)


def timed_in_turn(jobs: Sequence[Callable[[], object]], count: int) -> list[list[float]]:
    """Wall times of some jobs, one after another `count` times; a first round, which fills caches, is not counted."""
    rows: list[list[float]] = [[] for _ in jobs]
    for turn in range(count + 1):
        for job, row in zip(jobs, rows, strict=True):
            began_s = time.perf_counter()
            job()
            if turn:
                row.append(time.perf_counter() - began_s)
    return rows


def _ended(words: Sequence[str]) -> int:
    return subprocess.run(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False).returncode


def page_of(times: Times) -> str:
    """The page."""
    refused = times.refused_s / times.nothing_s
    libraries = times.libraries_s / times.warm_s
    return f"""# How long the command takes to start

`distalock bench locate_start`: medians of {times.count} runs in turn, in the same run on the same machine.

| | s | ratio |
|---|---|---|
| `distalock locate`, a process of its own | {times.cold_s:.2f} | {times.ratio:.2f} (limit {LARGEST_RATIO}) |
| the same image in a process that has localised one before | {times.warm_s:.2f} | 1 |
| NumPy, OpenCV, SciPy, numba and pydantic imported, and nothing else | {times.libraries_s:.2f} | {libraries:.2f} |
| `distalock locate --nope` | {times.refused_s:.2f} | {refused:.1f} of the next |
| `python -c pass` | {times.nothing_s:.2f} | 1 |

Warm localisation and libraries together take {1.0 + libraries:.2f} times the warm localisation. The rest of the cold
process defines this project's classes and loads the compiled kernels; several images in one process
(`distalock locate --each`) pay for it once.
"""


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
