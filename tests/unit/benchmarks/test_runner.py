"""The runner of benchmarks: rows on file, and a run that continues where it ended."""

import json
from functools import partial
from pathlib import Path

import pytest

from benchmarks.common.runner import RunPlan, SceneOptions, run_jobs
from shared.errors import InputError


def doubled(folder: Path, seed: int) -> float:
    (folder / str(seed)).touch(exist_ok=False)  # a second run of the same seed fails
    return 2.0 * seed


def test_a_run_continues_from_its_rows(tmp_path: Path) -> None:
    plan, job = RunPlan(processes=1, rows=tmp_path / "rows.jsonl"), partial(doubled, tmp_path)
    assert run_jobs(job, [3, 1], float, plan) == {3: 6.0, 1: 2.0}
    with (tmp_path / "rows.jsonl").open("a") as rows:
        rows.write('{"key": "7", "ro')  # cut off
    assert list(run_jobs(job, [1, 2, 3], float, plan).items()) == [(1, 2.0), (2, 4.0), (3, 6.0)]
    lines = (tmp_path / "rows.jsonl").read_text().splitlines()
    assert [json.loads(lines[k])["key"] for k in (0, 1, 3)] == ["3", "1", "2"]
    assert all(json.loads(lines[k])["revision"] for k in (0, 1, 3))


def test_a_scheduler_that_cannot_be_reached_is_bad_input() -> None:
    with pytest.raises(InputError, match="Dask"):
        run_jobs(partial(doubled, Path()), [1], float, RunPlan(scheduler="tcp://127.0.0.1:1"))


def test_shared_options_have_the_defaults_of_a_benchmark(tmp_path: Path) -> None:
    options = SceneOptions("some", "of some kind", count=5, seed=7, report=tmp_path / "page.md")
    assert list(options.parse([]).seeds) == [7, 8, 9, 10, 11]
    given = options.parse(["--count", "1", "--seed", "3", "--processes", "4", "--scheduler", "tcp://a:1"])
    assert (list(given.seeds), given.plan) == ([3], RunPlan(4, None, "tcp://a:1"))
