"""Seeded X-ray scenes with random parts, localised by every method and compared with the truth; writes a report.

usage: distalock bench accuracy [--count 1000] [--seed 20000] [--rows FILE] [--limit-every 10] [--limits FILE]
       [--processes 2] [--report FILE]

Every scene has its own ring and guide pattern and its own nail, so that nothing can be tuned to them. Beside the model
stand the paper's method whole, and its axis rule alone, on the same images. With `--rows`, what came out for each scene
is written to a file as soon as it is known, and a run that was interrupted continues where it ended; rows of another
revision of the sources are told in the report. The limits take most of the time and do not depend on any method: with
`--limits` they are those of an earlier run's rows, and only those that `--limit-every` asks for and that run has not
are worked out. The report, docs/benchmarks/accuracy.md with its pictures, is written when all scenes are there.
"""

import argparse
import subprocess
import sys
from collections import Counter
from collections.abc import Generator, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.accuracy.capture import Capture
from benchmarks.accuracy.localised_scenes import SceneRow, model_row, normalised, scene_row, scene_row_with_limit
from benchmarks.accuracy.plots import write_plots
from benchmarks.accuracy.report import report
from benchmarks.accuracy.rows import EarlierLimits, StoredRow, read_rows, write_row
from benchmarks.common.places import PAGES, ROOT
from benchmarks.common.statistics import Quantiles, quantiles
from distalock.arguments import OneLineParser, existing_file, seed_number, whole_number, writable_file

REPORT = PAGES / "accuracy.md"
FIRST_SEED, SCENES, LIMIT_EVERY, PROCESSES = 20_000, 1000, 10, 2
LEAST_ACCEPTED_SHARE = 0.9
MEASURED = (
    "services/registration/core",
    "services/imaging/core",
    "shared/geometry",
    "shared/xray",
    "simulation/render",
    "simulation/scenario",
    "benchmarks/scenes/random_scenes.py",
    "benchmarks/scenes/varied_parts.py",
)


@dataclass(frozen=True, slots=True)
class Statistics:
    """Counts and error quantiles (median, 95 %, worst) of our own method over the scenes that it accepted.

    `ended_wrong` counts the searches that ended at a wrong optimum, refused or not.
    """

    scenes: int
    accepted: int
    wrong: int
    refused_by_code: dict[str, int]
    ended_wrong: int
    entry_mm: Quantiles
    axis_deg: Quantiles
    normalised_entry: float
    normalised_axis: float


def main(arguments: Sequence[str] = ()) -> int:
    """Run what is missing and write the report; 0 when nothing is wrong and nine in ten are accepted."""
    given = _options(arguments)
    seeds = range(given.seed, given.seed + given.count)
    limits = EarlierLimits(given.limits)
    stored = read_rows(given.rows) if given.rows is not None else []
    known = {one.row.seed: limits.added_to(one) for one in stored if one.row.seed in seeds}
    missing = [seed for seed in seeds if seed not in known]
    limited = frozenset(seed for seed in seeds if given.limit_every and (seed - given.seed) % given.limit_every == 0)
    limited -= limits.seeds
    print(f"{len(known)} of {len(seeds)} scenes are known, {len(missing)} are to be run", flush=True)
    print(f"{len(limits.seeds & set(seeds))} limits are known, {len(limited & set(missing))} are to be worked out")
    revision = _revision() if missing else ""
    with closing(_run(missing, limited, given.processes)) as rows_found:
        for found in rows_found:
            one = known[found.seed] = limits.added_to(StoredRow(revision, found))
            if given.rows is not None:
                write_row(given.rows, one)
            print(_line(found), flush=True)
    rows = [known[seed].row for seed in seeds]
    revisions = sorted({source for seed in seeds for source in known[seed].sources}, key=lambda s: (" " in s, s))
    pictures = write_plots(rows, given.report.parent)
    given.report.write_text(report(rows, revisions, pictures))
    print(given.report.read_text())
    summary = summary_of(rows)
    return 0 if summary.wrong == 0 and summary.accepted >= LEAST_ACCEPTED_SHARE * summary.scenes else 1


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = OneLineParser(prog="distalock bench accuracy", description="random scenes, all methods")
    parser.add_argument(
        "--count",
        type=whole_number("a number of scenes", 1, 10**6),
        default=SCENES,
        help=f"number of scenes ({SCENES})",
    )
    parser.add_argument("--seed", type=seed_number, default=FIRST_SEED, help=f"seed of the first ({FIRST_SEED})")
    parser.add_argument(
        "--rows", type=writable_file, help="file for what came out of each scene; a run continues from it"
    )
    parser.add_argument(
        "--limit-every",
        type=whole_number("a number of scenes", 0, 10**6),
        default=LIMIT_EVERY,
        help=f"limit for every so many scenes ({LIMIT_EVERY}; 0: none)",
    )
    parser.add_argument("--limits", type=existing_file, help="rows of an earlier run, whose limits are taken")
    parser.add_argument(
        "--report", type=writable_file, default=REPORT, help="file for the tables; pictures go beside it"
    )
    parser.add_argument(
        "--processes",
        type=whole_number("a number of processes", 1, 256),
        default=PROCESSES,
        help=f"at once ({PROCESSES})",
    )
    return parser.parse_args(list(arguments))


def _run(seeds: Sequence[int], limited: frozenset[int], processes: int) -> Generator[SceneRow, None, None]:
    """Rows in the order in which they are done; what has not begun when it is closed is given up."""
    with ProcessPoolExecutor(processes, initializer=_one_thread) as pool:
        jobs = [pool.submit(scene_row_with_limit if seed in limited else scene_row, seed) for seed in seeds]
        try:
            for job in as_completed(jobs):
                yield job.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _one_thread() -> None:
    """Two processes fill two cores: OpenCV must not start threads of its own."""
    cv2.setNumThreads(1)


def _revision() -> str:
    """Last commit that touched what is measured, with a plus when some of it is not committed."""
    git = ["git", "-C", str(ROOT)]
    last = subprocess.run(
        [*git, "log", "-1", "--format=%h", "--", *MEASURED], capture_output=True, text=True, check=False
    )
    changed = subprocess.run([*git, "status", "--short", "--", *MEASURED], capture_output=True, text=True, check=False)
    return (last.stdout.strip() or "unknown") + ("+" if changed.stdout.strip() else "")


def _line(row: SceneRow) -> str:
    """One scene for people who watch."""
    verdict = "WRONG" if row.wrong else ", ".join(row.model.codes) or "accepted"
    error = "-" if row.model.holes is None else f"{row.model.entry_mm:.3f} mm {row.model.axis_deg:.3f}°"
    return f"{row.seed} tilt {row.kind.tilt_deg:.1f}° {row.kind.material}: {verdict}, {error}, search {row.capture}"


def statistics(seeds: Iterable[int]) -> Statistics:
    """Localise the scenes of some seeds by our own method, one after another."""
    return summary_of([model_row(seed) for seed in seeds])


def summary_of(rows: Sequence[SceneRow]) -> Statistics:
    """Counts and quantiles of our own method."""
    accepted = [row.model for row in rows if row.model.accepted]
    entry, axis = normalised(accepted)
    return Statistics(
        scenes=len(rows),
        accepted=len(accepted),
        wrong=sum(row.wrong for row in rows),
        refused_by_code=dict(Counter(code for row in rows for code in row.model.codes)),
        ended_wrong=sum(row.capture is Capture.WRONG for row in rows),
        entry_mm=quantiles(one.entry_mm for one in accepted),
        axis_deg=quantiles(one.axis_deg for one in accepted),
        normalised_entry=entry,
        normalised_axis=axis,
    )


if __name__ == "__main__":
    np.seterr(all="warn")
    sys.exit(main(sys.argv[1:]))
