"""The command that the benchmarks of this folder share: options, the two passes over scenes, and the page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pydantic import TypeAdapter

from benchmarks.common.places import PAGES
from benchmarks.common.runner import RowFile, RunPlan, add_run_options, run_jobs, run_plan
from benchmarks.robustness.kinds import CONTROL, CONTROL_KIND, Kind
from benchmarks.robustness.page import section_of, with_section, write_sheet
from benchmarks.robustness.rows import Row, key_of, kind_row
from distalock.arguments import OneLineParser, existing_file, whole_number, writable_file
from shared.errors import InputError

REPORT = PAGES / "robustness.md"
# Seeds from 60000 fit parameters of the localisation; those from 65000 judge them and fit nothing.
FIT = "fit"
SEEDS: Mapping[str, int] = {FIT: 60_000, "judged": 65_000}
SEEDS_OF_A_SET = 5_000


@dataclass(frozen=True, slots=True)
class RobustnessBench:
    """A benchmark of this folder."""

    name: str
    description: str
    kinds: tuple[Kind, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all kinds, the control's first."""
        return CONTROL, *(kind.name for kind in self.kinds)


def run_bench(bench: RobustnessBench, arguments: Sequence[str]) -> int:
    """Localise scenes of the chosen kinds, print and write the table; 0 when nothing is accepted wrong or crashes."""
    given = _parser(bench).parse_args(list(arguments))
    kinds = chosen_kinds(bench, given.kind or bench.names, given.seeds)
    first = SEEDS[given.seeds] + given.skip
    rows = rows_of(kinds, range(first, first + given.count), given.images, run_plan(given))
    seeds = f"{first}-{first + given.count - 1} ({given.seeds})"
    before = None if given.before is None else list(_stored(given.before).values())
    section = section_of(bench.name, seeds, kinds, rows, before)
    print(section)
    report = given.report if given.kind else given.report or REPORT
    if report is not None:
        write_sheet(report.with_name(f"robustness-{bench.name}.png"), kinds, first, given.images)
        report.write_text(with_section(report, bench.name, section))
    return int(any(row.wrong or row.crashed for row in rows))


def chosen_kinds(bench: RobustnessBench, names: Sequence[str], seeds: str) -> tuple[Kind, ...]:
    """The named kinds; on seeds that fit, without those that are held out.

    Raises
    ------
    InputError
        When none is left.
    """
    named = (kind for kind in (CONTROL_KIND, *bench.kinds) if kind.name in names)
    kinds = tuple(kind for kind in named if seeds != FIT or not kind.judges_only)
    if not kinds:
        raise InputError(f"held out of the seeds that fit: {', '.join(names)}; use --seeds judged")
    return kinds


def rows_of(kinds: Sequence[Kind], seeds: Sequence[int], images: Path | None, plan: RunPlan) -> list[Row]:
    """Rows of the controls first, because those of the kinds carry the control's verdict."""
    keys = [key_of(CONTROL, seed) for seed in seeds]
    controls = run_jobs(partial(kind_row, (CONTROL_KIND,), {}, images), keys, Row, plan)
    codes = {row.seed: row.codes for row in controls.values()}
    others = [key_of(kind.name, seed) for seed in seeds for kind in kinds if kind is not CONTROL_KIND]
    found = run_jobs(partial(kind_row, kinds, codes, images), others, Row, plan)
    return [*(controls.values() if CONTROL_KIND in kinds else ()), *found.values()]


def _stored(file: Path) -> dict[str, Row]:
    return RowFile(file, TypeAdapter(Row)).read()


def _parser(bench: RobustnessBench) -> OneLineParser:
    parser = OneLineParser(prog=f"distalock bench {bench.name}", description=bench.description)
    number = partial(whole_number, "a number of scenes")
    parser.add_argument(
        "--kind",
        action="append",
        choices=bench.names,
        metavar="NAME",
        help=f"may be given again (all): {', '.join(bench.names)}",
    )
    parser.add_argument("--count", type=number(1, SEEDS_OF_A_SET), default=20, help="scenes of each kind (20)")
    parser.add_argument(
        "--seeds",
        choices=tuple(SEEDS),
        default="judged",
        help="fit: from 60000, to fit parameters on, without kinds held out; judged: from 65000 (judged)",
    )
    parser.add_argument("--skip", type=number(0, SEEDS_OF_A_SET - 1), default=0, help="seeds left out at the start (0)")
    parser.add_argument("--images", type=Path, help="folder that keeps rendered images, so that no run renders again")
    parser.add_argument("--before", type=existing_file, help="rows of an earlier revision, for a second table")
    parser.add_argument(
        "--report", type=writable_file, help="page to write (docs/benchmarks/robustness.md; with --kind: none)"
    )
    add_run_options(parser)
    return parser
