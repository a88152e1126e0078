"""The console in a real browser; writes docs/benchmarks/console.md.

usage: distalock bench console [PART ...] [--report FILE]
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from benchmarks.common.operating_room import OperatingRoom, running
from benchmarks.common.places import PAGES
from benchmarks.console import absence, axe_states, drawing, first_load, picture_time, screen_stop, setup_time
from benchmarks.console.browser import NO_CHROMIUM, chromium_path
from benchmarks.console.section import Section, with_sections
from distalock.arguments import writable_file
from distalock.installation import Installation, Ports
from shared.arguments import OneLineParser
from shared.errors import InputError

REPORT: Final = PAGES / "console.md"
_SEED: Final = "2"


def _in_a_room(measure: Callable[[OperatingRoom], Section]) -> Callable[[], Section]:
    def run() -> Section:
        with tempfile.TemporaryDirectory() as folder:
            installation = Installation(Ports.any_free(), Path(folder), scenario_arguments=("--seed", _SEED))
            with running(installation) as site:
                return measure(site)

    return run


# In the order of the page.
PARTS: Final[Mapping[str, tuple[str, Callable[[], Section]]]] = {
    "axe": (axe_states.TITLE, _in_a_room(axe_states.measure)),
    "picture": (picture_time.TITLE, _in_a_room(picture_time.measure)),
    "drawing": (drawing.TITLE, _in_a_room(drawing.measure)),
    "absence": (absence.TITLE, _in_a_room(absence.measure)),
    "stop": (screen_stop.TITLE, screen_stop.measure),
    "load": (first_load.TITLE, _in_a_room(first_load.measure)),
    "setup": (setup_time.TITLE, setup_time.measure),
}


def main(arguments: Sequence[str] = ()) -> int:
    """Measure the parts that are named, or all; 1 when a limit does not hold."""
    given = _options(arguments)
    if chromium_path() is None:
        raise InputError(NO_CHROMIUM)
    found: dict[str, Section] = {}
    for name in given.parts or PARTS:
        found[name] = _with_load(PARTS[name][1]())
        print(f"## {found[name].title}\n\n{found[name].text}")
        # After each part: one that fails does not cost those before it.
        given.report.write_text(
            with_sections(given.report, found, [title for title, _ in PARTS.values()]), encoding="utf-8"
        )
    missed = [one.title for one in found.values() if not one.holds]
    print(f"limits missed in: {', '.join(missed)}" if missed else "all limits hold")
    return int(bool(missed))


def _with_load(section: Section) -> Section:
    """What else the machine had to do stands with every figure."""
    load = f"Load average of the minute before the end: {os.getloadavg()[0]:.1f}, on {os.cpu_count()} processors.\n"
    return replace(section, text=f"{section.text.rstrip()}\n\n{load}")


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = OneLineParser(prog="distalock bench console", description="the console in a real browser")
    parser.add_argument("parts", nargs="*", type=_part, metavar="PART", help=f"of {', '.join(PARTS)}; all unless named")
    parser.add_argument("--report", type=writable_file, default=REPORT, help="file for the page")
    return parser.parse_args(list(arguments))


def _part(word: str) -> str:
    if word not in PARTS:
        raise argparse.ArgumentTypeError(f"there is no part '{word}'; there are {', '.join(PARTS)}")
    return word


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
