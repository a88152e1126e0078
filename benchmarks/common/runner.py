"""One runner for benchmarks over many seeded scenes: rows on file, resumable, here or on a Dask cluster.

A benchmark names a job, a function of one key (a seed, mostly) that can be imported in another process, and gets its
rows back by key::

    options = SceneOptions("fusion", description, count=60, seed=1, report=REPORT)
    given = options.parse(arguments)
    rows = run_jobs(seen_set_up, given.seeds, given.plan)

With a file for rows (`--rows`), each row is appended as soon as it is known, with the revision of the sources, and a
run that was interrupted continues where it ended. Worker processes of this machine do the work, or the workers of a
Dask cluster (`--scheduler ADDRESS`), which need the same checkout and the extra `bench`.
"""

import argparse
import importlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Generic, Protocol, Self, TypeVar

import cv2
from pydantic import TypeAdapter, ValidationError
from rich.console import Console
from rich.progress import Progress

from distalock.arguments import OneLineParser, seed_number, whole_number, writable_file
from distalock.version import revision
from shared.errors import InputError
from shared.json_lines import json_lines

R = TypeVar("R")
K = TypeVar("K", int, str)
PROCESSES = 2
# Which revision a row is of: the sources that decide what comes out, beside the benchmark's own.
MEASURED = ("services", "shared", "simulation", "baselines", "benchmarks")


@dataclass(frozen=True, slots=True)
class RunPlan:
    """Where jobs run, and where their rows are kept.

    Attributes
    ----------
    rows
        JSON lines; None to keep none.
    scheduler
        Address of a Dask scheduler; None for processes of this machine.
    """

    processes: int = PROCESSES
    rows: Path | None = None
    scheduler: str | None = None


@dataclass(frozen=True, slots=True)
class GivenOptions:
    """What a benchmark was started with."""

    count: int
    seed: int
    report: Path
    plan: RunPlan

    @property
    def seeds(self) -> range:
        """Seeds of the scenes."""
        return range(self.seed, self.seed + self.count)


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """The options that benchmarks over scenes share, with one benchmark's defaults."""

    name: str
    description: str
    count: int
    seed: int
    report: Path

    def parser(self) -> OneLineParser:
        """A parser of the shared options; a benchmark may add its own."""
        parser = OneLineParser(prog=f"distalock bench {self.name}", description=self.description)
        scenes = whole_number("a number of scenes", 1, 10**6)
        parser.add_argument("--count", type=scenes, default=self.count, help=f"number of scenes ({self.count})")
        parser.add_argument("--seed", type=seed_number, default=self.seed, help=f"seed of the first ({self.seed})")
        parser.add_argument("--report", type=writable_file, default=self.report, help="file for the page")
        add_run_options(parser)
        return parser

    def parse(self, arguments: Sequence[str]) -> GivenOptions:
        """Parse them; ends with one line on stderr when they are wrong."""
        given = self.parser().parse_args(list(arguments))
        return GivenOptions(given.count, given.seed, given.report, run_plan(given))


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Declare where jobs run and where their rows are kept."""
    number = whole_number("a number of processes", 1, 256)
    parser.add_argument("--rows", type=writable_file, help="file for the row of each scene; a run continues from it")
    parser.add_argument("--processes", type=number, default=PROCESSES, help=f"at once on this machine ({PROCESSES})")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler, such as tcp://10.0.0.5:8786")


def run_plan(given: argparse.Namespace) -> RunPlan:
    """The plan that parsed options describe."""
    return RunPlan(given.processes, given.rows, given.scheduler)


def run_jobs(job: Callable[[K], R], keys: Sequence[K], row_type: type[R], plan: RunPlan = RunPlan()) -> dict[K, R]:
    """Rows of some keys, in their order: those on file, and the others as the job makes them.

    Parameters
    ----------
    job
        A function of a module, or a `partial` of one, so that other processes can import it.
    row_type
        What it returns; anything that pydantic can write as JSON.

    Raises
    ------
    InputError
        When no Dask scheduler answers, or Dask is not installed.
    """
    store = RowFile(plan.rows, TypeAdapter(row_type))
    known = store.read()
    missing = [key for key in keys if str(key) not in known]
    made_of = revision(MEASURED) or "unknown"
    with Progress(console=Console(stderr=True)) as progress:
        task = progress.add_task("scenes", total=len(keys), completed=len(keys) - len(missing))
        with _pool(plan) as pool:
            for key, row in pool.results(job, missing):
                known[str(key)] = row
                store.append(str(key), row, made_of)
                progress.advance(task)
    return {key: known[str(key)] for key in keys}


class RowFile(Generic[R]):
    """Rows on file: JSON lines of key, revision and row."""

    def __init__(self, file: Path | None, row: TypeAdapter[R]) -> None:
        self._file, self._row = file, row

    def read(self) -> dict[str, R]:
        """Rows by key; lines that are none, as one that was cut off, are left out."""
        if self._file is None or not self._file.exists():
            return {}
        found: dict[str, R] = {}
        for line in json_lines(self._file.read_text()):
            try:
                entry = json.loads(line)
                found[entry["key"]] = self._row.validate_python(entry["row"])
            except (ValueError, KeyError, TypeError, ValidationError):
                print(f"{self._file}: a line is no row and left out: {line[:60]}")
        return found

    def append(self, key: str, row: R, made_of: str) -> None:
        """Add a row, on a line of its own even after a line that was cut off."""
        if self._file is None:
            return
        cut_off = self._file.exists() and self._file.read_bytes()[-1:] not in (b"\n", b"")
        entry = {"key": key, "revision": made_of, "row": self._row.dump_python(row, mode="json")}
        with self._file.open("a") as lines:
            lines.write("\n" * cut_off + json.dumps(entry) + "\n")


class _Pool(Protocol):
    """Where jobs run."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *exception: object) -> None: ...

    def results(self, job: Callable[[K], R], keys: Iterable[K]) -> Iterator[tuple[K, R]]:
        """Key and row, in the order in which they are done."""


def _pool(plan: RunPlan) -> _Pool:
    return _Processes(plan.processes) if plan.scheduler is None else _Cluster(plan.scheduler)


class _Processes:
    """Processes of this machine; what has not begun when the pool is closed is given up."""

    def __init__(self, processes: int) -> None:
        self._pool = ProcessPoolExecutor(processes, initializer=one_thread)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)

    def results(self, job: Callable[[K], R], keys: Iterable[K]) -> Iterator[tuple[K, R]]:
        jobs = {self._pool.submit(job, key): key for key in keys}
        for done in as_completed(jobs):
            yield jobs[done], done.result()


class _Cluster:
    """The workers of a Dask cluster."""

    def __init__(self, address: str) -> None:
        try:
            self._dask = importlib.import_module("distributed")
        except ImportError:
            raise InputError("--scheduler needs Dask: pip install 'distalock[bench]'") from None
        try:
            self._client = self._dask.Client(address, timeout="10s")
        except (OSError, ValueError) as error:
            raise InputError(
                f"no Dask scheduler answers at {address}: {error}; start one with `dask scheduler`"
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._client.close()

    def results(self, job: Callable[[K], R], keys: Iterable[K]) -> Iterator[tuple[K, R]]:
        jobs = {self._client.submit(partial(_in_one_thread, job), key, pure=False): key for key in keys}
        for done in self._dask.as_completed(jobs):
            yield jobs[done], done.result()


def _in_one_thread(job: Callable[[K], R], key: K) -> R:
    one_thread()
    return job(key)


def one_thread() -> None:
    """As many processes as cores fill them: OpenCV must not start threads of its own."""
    cv2.setNumThreads(1)
