"""Each tuned value 30 % larger and 30 % smaller: what happens to verdicts and errors on a fixed set of scenes.

usage: distalock bench sensitivity [--count 6] [--seed 30300] [--only GROUP] [--rows FILE] [--scenes FOLDER]
       [--processes 2] [--scheduler ADDRESS] [--report FILE]

The scenes are rendered once into a folder. Every change is made in a process of its own job, for all scenes at once;
with `--rows` an interrupted run continues. Integers change by at least 1; of a tuple all numbers change together. The
page, docs/benchmarks/sensitivity.md, lists for each value how many verdicts change, the change of the median and of
the worst error, and the largest shift of an axis in its predicted standard deviations; then the values on which
nothing depends in these scenes.
"""

import argparse
import importlib
import importlib.util
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median

from benchmarks.accuracy.same_results import located_row, shift_sd, verdict_of, write_scenes
from benchmarks.common.places import PAGES, ROOT
from benchmarks.common.runner import SceneOptions, run_jobs, run_plan
from benchmarks.data.independent_images import listed_images
from distalock.arguments import named_path
from shared.errors import InputError
from shared.tuning import TunedValue, overridden, values_of

REPORT = PAGES / "sensitivity.md"
SCENES_FOLDER = ROOT / "out" / "sensitivity"
FIRST_SEED, SCENES = 30_300, 6
FACTORS = (1.3, 0.7)
AS_DECLARED = "as declared"
MODULES = ("services.imaging.core.tuning", "shared.xray.tuning", "services.registration.core.tuning")
Row = list[dict[str, object]]


@dataclass(frozen=True, slots=True)
class Effect:
    """What one change of one value does, over all scenes.

    Attributes
    ----------
    verdicts
        Images whose verdict or reason codes change.
    median_mm, worst_mm
        Change of the entry error over the holes that are found.
    shift_sd
        Largest shift of an axis in predicted standard deviations.
    failure
        What was raised; empty when nothing was.
    """

    verdicts: int
    median_mm: float
    worst_mm: float
    shift_sd: float
    failure: str = ""

    @property
    def none(self) -> bool:
        """Whether nothing at all changed."""
        return not (self.verdicts or self.failure or self.shift_sd > 0.0)


def main(arguments: Sequence[str] = ()) -> int:
    """Change every value, print and write the page; 0 unless nothing can be changed."""
    given = _options(arguments)
    values = [one for one in tuned_numbers() if given.only in (None, one.group)]
    if not values:
        groups = ", ".join(sorted({one.group for one in tuned_numbers()}))
        raise InputError(f"there is no group {given.only!r} of tuned values; there are {groups}")
    folder = given.scenes / f"{given.seed}-{given.count}"
    if not (folder / "manifest.json").is_file():
        write_scenes(folder, range(given.seed, given.seed + given.count))
    keys = [AS_DECLARED, *(key_of(one, factor) for one in values for factor in FACTORS)]
    rows = run_jobs(partial(changed_row, str(folder)), keys, list[dict[str, object]], run_plan(given))
    page = report(values, rows, given.count, given.only)
    print(page)
    given.report.write_text(page)
    return 0


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    shared = SceneOptions("sensitivity", "each tuned value 30 % larger and smaller", SCENES, FIRST_SEED, REPORT)
    parser = shared.parser()
    parser.add_argument("--only", metavar="GROUP", help="values of one dataclass only")
    parser.add_argument("--scenes", type=named_path, default=SCENES_FOLDER, help="folder for the rendered scenes")
    return parser.parse_args(list(arguments))


def settings() -> Iterator[object]:
    """Every settings instance of the modules that declare tuned values."""
    for name in MODULES:
        if importlib.util.find_spec(name) is not None:
            yield from importlib.import_module(name).SETTINGS


def tuned_numbers() -> list[TunedValue]:
    """Values that can be made larger and smaller: numbers, and tuples of numbers."""
    return [one for group in settings() for one in values_of(group) if scaled(one.value, FACTORS[0]) is not None]


def scaled(value: object, factor: float) -> object | None:
    """A number, or all numbers of a tuple, times a factor; integers change by at least 1; None for anything else."""
    if isinstance(value, bool):
        return None
    if isinstance(value, int):
        step = max(1, round(abs(value * (factor - 1.0))))
        return value + step if factor > 1.0 else value - step
    if isinstance(value, float):
        return value * factor
    if isinstance(value, tuple) and value:
        parts = [scaled(one, factor) for one in value]
        return None if None in parts else tuple(parts)
    return None


def key_of(value: TunedValue, factor: float) -> str:
    """Name of one change, such as ``NailBandSearch.step_mm x 1.3``."""
    return f"{value.group}.{value.name} x {factor:g}"


def changed_row(folder: str, key: str) -> Row:
    """Localise all scenes with one value changed."""
    for group in settings():
        for one in values_of(group):
            for factor in FACTORS:
                if key == key_of(one, factor):
                    with overridden(group, {one.name: scaled(one.value, factor)}):
                        return _located(Path(folder))
    return _located(Path(folder))


def _located(folder: Path) -> Row:
    try:
        return [located_row(image) for image in listed_images(folder)]
    except Exception as error:  # noqa: BLE001 - a changed value may break any assumption: that is a result
        return [{"failure": f"{type(error).__name__}: {error}"}]


def effect_of(before: Row, after: Row) -> Effect:
    """Compare a changed run with that of the values as declared."""
    if "failure" in after[0]:
        return Effect(0, 0.0, 0.0, 0.0, str(after[0]["failure"]))
    was, becomes = errors_mm(before), errors_mm(after)
    pairs = list(zip(before, after, strict=True))
    return Effect(
        sum(verdict_of(one) != verdict_of(other) for one, other in pairs),
        median(becomes) - median(was) if was and becomes else float("nan"),
        max(becomes) - max(was) if was and becomes else float("nan"),
        max((shift_sd(one, other) for one, other in pairs if one["holes"] and other["holes"]), default=0.0),
    )


def errors_mm(row: Row) -> list[float]:
    """True entry errors of all holes that were found."""
    return [error for one in row for error in one["entry_errors_mm"]]  # type: ignore[attr-defined]


def report(values: Sequence[TunedValue], rows: Mapping[str, Row], scenes: int, only: str | None = None) -> str:
    """The page, as Markdown."""
    before = rows[AS_DECLARED]
    effects = {one: [effect_of(before, rows[key_of(one, factor)]) for factor in FACTORS] for one in values}
    ordered = sorted(
        effects.items(), key=lambda item: max(e.shift_sd + 100 * e.verdicts for e in item[1]), reverse=True
    )
    unused = [f"`{one.group}.{one.name}`" for one, pair in effects.items() if all(e.none for e in pair)]
    lines = [
        "# What verdicts and errors owe to each tuned value",
        "",
        "`distalock bench sensitivity`: each value of [tuning.md](../tuning.md) 30 % larger and 30 % smaller,",
        f"on {scenes} random scenes that judge nothing else. Verdict changes count images; errors are the true entry",
        "errors, larger value first; the shift is the largest of any axis in its predicted standard deviations.",
        *([f"Measured so far: `{only}` (`--only {only}`)."] if only else []),
        "",
        "| value | verdicts that change | median error, mm | worst error, mm | shift, sd |",
        "|---|---|---|---|---|",
        *(_line(one, pair) for one, pair in ordered if not all(e.none for e in pair)),
        "",
        f"Nothing changes in these scenes with: {', '.join(unused) or 'none'}.",
        "",
    ]
    return "\n".join(lines)


def _line(value: TunedValue, effects: Sequence[Effect]) -> str:
    failures = "; ".join(e.failure for e in effects if e.failure)
    cells = (
        f"`{value.group}.{value.name}`" + (f" (raises {failures[:80]})" if failures else ""),
        ", ".join(str(e.verdicts) for e in effects),
        ", ".join(f"{e.median_mm:+.4f}" for e in effects),
        ", ".join(f"{e.worst_mm:+.4f}" for e in effects),
        ", ".join(f"{e.shift_sd:.3f}" for e in effects),
    )
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
