"""`distalock bench faults`: every fault at every step of the procedure; writes its table into docs/faults.md."""

import argparse
import sys
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter

from benchmarks.common.places import ROOT
from benchmarks.common.runner import MEASURED, RowFile
from benchmarks.faults.combination import Finding
from benchmarks.faults.page import finding_line, with_table
from benchmarks.faults.passes import Pass, passes, without
from benchmarks.faults.patient import STEPS
from benchmarks.faults.play import play
from benchmarks.faults.small_disks import has_mounts_of_its_own, with_mounts_of_its_own
from benchmarks.faults.table import FAULTS
from distalock.arguments import OneLineParser, seed_number, whole_number, writable_file
from distalock.version import revision

PAGE: Final = ROOT / "docs" / "faults.md"
_MODULE: Final = "benchmarks.faults.command"
_SEED: Final = 2
# Another process may take the machine for some seconds: what fails is tried once more, on another installation.
_ATTEMPTS: Final = 2
_TENTH: Final = 10


def main(arguments: Sequence[str]) -> int:
    """Exit code 0 when everything that was tried was survived."""
    given = _parser().parse_args(list(arguments))
    code = with_mounts_of_its_own(_MODULE, arguments)
    return _run(given) if code is None else code


def _parser() -> OneLineParser:
    parser = OneLineParser(prog="distalock bench faults", description=__doc__)
    parser.add_argument("--seed", type=seed_number, default=_SEED, help=f"order, and scenario of the room ({_SEED})")
    parser.add_argument("--rows", type=writable_file, help="file for the findings; a run continues from it")
    parser.add_argument("--logs", type=Path, help="folder for the logs of installations that did not survive")
    parser.add_argument("--processes", type=whole_number("installations at once", 1, 8), default=1)
    parser.add_argument("--tenth", action="store_true", help="a tenth of the combinations, chosen by the seed")
    parser.add_argument("--fault", action="append", choices=[f.name for f in FAULTS], help="only this one; repeatable")
    parser.add_argument("--step", action="append", choices=list(STEPS), help="only at this one; repeatable")
    return parser


def _run(given: argparse.Namespace) -> int:
    store = RowFile(given.rows, TypeAdapter(Finding))
    found, chosen = store.read(), _chosen(given)
    for attempt in range(1, _ATTEMPTS + 1):
        left = without(chosen, {key for key, finding in found.items() if finding.survived})
        if left and attempt > 1:
            print(f"tried once more: {', '.join(planned.key for each in left for planned in each)}", flush=True)
        _try_all(left, given, found, store)
    tried = [found[planned.key] for each in chosen for planned in each]
    failed = [finding for finding in tried if not finding.survived]
    print(f"{len(tried) - len(failed)} of {len(tried)} combinations survived")
    if not (given.tenth or given.fault or given.step):
        PAGE.write_text(with_table(PAGE.read_text(), tried, datetime.now(UTC).date()))
    return 1 if failed else 0


def _try_all(
    left: Sequence[Pass], given: argparse.Namespace, found: dict[str, Finding], store: RowFile[Finding]
) -> None:
    """Try passes, several installations at once; each finding is kept and printed as soon as it is known."""
    waiting, lock, made_of = iter(left), threading.Lock(), revision(MEASURED) or "unknown"

    def next_pass() -> Pass | None:
        with lock:
            return next(waiting, None)

    def work() -> None:
        for planned, finding in play(next_pass, given.seed, given.logs):
            with lock:
                found[planned.key] = finding
                store.append(planned.key, finding, made_of)
                print(finding_line(finding), flush=True)

    with ThreadPoolExecutor(given.processes) as pool:
        for worker in [pool.submit(work) for _ in range(given.processes)]:
            worker.result()


def _chosen(given: argparse.Namespace) -> list[Pass]:
    """The passes that are asked for, less what cannot be tried on this machine, which is said."""
    tried = [fault for fault in FAULTS if has_mounts_of_its_own() or not fault.needs_mounts]
    if missing := [fault.name for fault in FAULTS if fault not in tried]:
        print(f"not tried, for this machine gives nobody mounts of his own: {', '.join(missing)}")
    all_passes = passes(tried, given.seed)
    if given.tenth:
        all_passes = all_passes[: max(round(len(all_passes) / _TENTH), 1)]
    wanted = [
        tuple(p for p in each if _is_wanted(p.fault.name, given.fault) and _is_wanted(p.step, given.step))
        for each in all_passes
    ]
    return [each for each in wanted if each]


def _is_wanted(name: str, chosen: Sequence[str] | None) -> bool:
    return chosen is None or name in chosen


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
