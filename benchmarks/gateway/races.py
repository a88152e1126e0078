"""Two surgeons approve, move, take back and stop at once: one motion, one record, clear answers.

usage: distalock bench races [--races 500] [--with-images 25] [--seed 1] [--minutes 120] [--rows FILE] [--report FILE]

For each race there is a plan that would move the robot by a millimetre or two. Two surgeons, each with an account and a
session of his own, play seeded scripts against it at the same time; some requests are sent twice under one key. What
came of it is judged by the answers, by what went over the controller's line, by the controller's own truth and by the
record. With `--rows FILE` a run continues where it ended.
"""

import argparse
import random
import sys
import time
from collections.abc import Container, Iterable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from threading import Barrier, Thread
from typing import Final

from pydantic import TypeAdapter

from benchmarks.common.places import PAGES, ROOT
from benchmarks.common.runner import RowFile
from benchmarks.gateway.race_judgement import Race, faults_of, record_faults
from benchmarks.gateway.race_page import page_of
from benchmarks.gateway.race_room import NoPlan, PlansFrom, RaceRoom
from benchmarks.gateway.race_rows import AnswerRow, RaceRow, RecordTail
from benchmarks.gateway.race_with_images import room_with_images
from benchmarks.gateway.race_with_stand_in import room_with_stand_in
from benchmarks.gateway.surgeons import Surgeon, new_surgeon, script
from distalock.arguments import seed_number, whole_number, writable_file
from distalock.version import revision
from shared.arguments import OneLineParser

REPORT: Final = PAGES / "races.md"
RACES: Final = 500
WITH_IMAGES: Final = 25
SEED: Final = 1
MINUTES: Final = 120
SCENARIO: Final = 1
NAMES: Final = ("anna", "boris")
_DOCUMENTS: Final = ("rest.md", "procedure.md", "refusals.md")
_MEASURED: Final = ("services", "shared", "benchmarks/gateway")
# Stops are on record two seconds after their answer at the latest.
_ON_RECORD_WITHIN_S: Final = 5.0
_POLL_S: Final = 0.05
_MOST_WITHOUT_PLAN: Final = 3


class DocumentedCodes:
    """The codes of refusals that the documents name."""

    def __init__(self, folder: Path = ROOT / "docs") -> None:
        self._text = "\n".join((folder / name).read_text() for name in _DOCUMENTS)

    def __contains__(self, code: object) -> bool:
        return f"`{code}`" in self._text


class Races:
    """Races in one room.

    Parameters
    ----------
    documented
        The codes of refusals that the documents name.
    """

    def __init__(self, room: RaceRoom, seed: int, documented: Container[str]) -> None:
        self._room, self._seed, self._documented = room, seed, documented
        self._surgeons = [new_surgeon(room.rest, room.url, name, room.case_id) for name in NAMES]
        self._record = RecordTail(room.state_dir)

    def run(self, number: int) -> RaceRow:
        """Prepare, race and judge; raises `NoPlan`."""
        began_s, source = time.monotonic(), random.Random(f"{self._seed}-{number}")
        race = self._raced(source)
        on_record = self._record_faults(race)
        faults = (*faults_of(race, self._documented), *on_record, *self._record.chain_faults())
        kept = tuple(map(AnswerRow.of, race.answers))
        moves = sum(one.what == "move" for one in race.commanded)
        stops = len(race.commanded) - moves
        return RaceRow(number, self._room.plans_from, kept, moves, stops, faults, round(time.monotonic() - began_s, 3))

    def _raced(self, source: random.Random) -> Race:
        room = self._room
        plan = room.plan(source)
        room.line.taken()
        self._record.pass_over()
        start = Barrier(len(self._surgeons))
        threads = [
            _playing(surgeon, (script(source), plan.number, f'"{plan.sha256}"', start)) for surgeon in self._surgeons
        ]
        for thread in threads:
            thread.join()
        operations = room.operations(plan.number)
        answers = tuple(answer for surgeon in self._surgeons for answer in surgeon.answers)
        return Race(answers, room.line.taken(), operations, room.stop_is_latched(), room.is_at_rest())

    def _record_faults(self, race: Race) -> list[str]:
        """What the record lacks, or has too much, once all had its time to be recorded."""
        deadline_s = time.monotonic() + _ON_RECORD_WITHIN_S
        while (found := record_faults(self._record.events(), race.answers)) and time.monotonic() < deadline_s:
            time.sleep(_POLL_S)
        return found


def _playing(surgeon: Surgeon, arguments: tuple[object, ...]) -> Thread:
    surgeon.answers.clear()
    thread = Thread(target=surgeon.play, args=arguments, daemon=True)
    thread.start()
    return thread


def run_numbers(races: Races, numbers: Iterable[int], deadline_s: float) -> Iterable[RaceRow]:
    """Rows of these races, until the time is over; a race without a plan is told and left for another run.

    Raises
    ------
    NoPlan
        When none of several races in succession has a plan.
    """
    without_plan = 0
    for number in numbers:
        if time.monotonic() > deadline_s:
            return
        try:
            yield races.run(number)
        except NoPlan as lack:
            print(f"race {number}: {lack}", flush=True)
            without_plan += 1
            if without_plan >= _MOST_WITHOUT_PLAN:
                raise
        else:
            without_plan = 0


def main(arguments: Sequence[str] = ()) -> int:
    """Run what no row is there of, write the page; 1 when anything is wrong."""
    given = _options(arguments)
    store, deadline_s = RowFile(given.rows, TypeAdapter(RaceRow)), time.monotonic() + 60.0 * given.minutes
    rows = {key: row for key, row in store.read().items() if key.startswith(f"{given.seed} ")}
    made_of = revision(_MEASURED) or "unknown"
    with_images = min(given.with_images, given.races)
    parts: tuple[tuple[PlansFrom, range], ...] = (
        ("images", range(with_images)),
        ("stand_in", range(with_images, given.races)),
    )
    for plans_from, numbers in parts:
        missing = [number for number in numbers if f"{given.seed} {plans_from} {number}" not in rows]
        if not missing or time.monotonic() > deadline_s:
            continue
        with _room(plans_from) as room:
            for row in run_numbers(Races(room, given.seed, DocumentedCodes()), missing, deadline_s):
                key = f"{given.seed} {plans_from} {row.number}"
                rows[key] = row
                store.append(key, row, made_of)
                _tell(row, len(rows))
    page = page_of(sorted(rows.values(), key=lambda row: row.number), given.seed)
    given.report.write_text(page)
    print(page)
    return 1 if any(row.faults for row in rows.values()) or len(rows) < given.races else 0


def _room(plans_from: PlansFrom) -> AbstractContextManager[RaceRoom]:
    return room_with_images(SCENARIO) if plans_from == "images" else room_with_stand_in()


def _tell(row: RaceRow, done: int) -> None:
    for fault in row.faults:
        print(f"race {row.number}: {fault}", flush=True)
    if done % 10 == 0:
        print(f"{done} races", flush=True)


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = OneLineParser(prog="distalock bench races", description="two surgeons at once")
    parser.add_argument("--races", type=whole_number("a number of races", 1, 10**5), default=RACES, help=f"({RACES})")
    images = whole_number("a number of races", 0, 10**5)
    help_images = f"races whose plans are of images in the virtual operating room ({WITH_IMAGES})"
    parser.add_argument("--with-images", type=images, default=WITH_IMAGES, help=help_images)
    parser.add_argument("--seed", type=seed_number, default=SEED, help=f"of the scripts ({SEED})")
    minutes = whole_number("minutes", 1, 10**4)
    parser.add_argument("--minutes", type=minutes, default=MINUTES, help=f"after which no race begins ({MINUTES})")
    parser.add_argument("--rows", type=writable_file, help="file for the row of each race; a run continues from it")
    parser.add_argument("--report", type=writable_file, default=REPORT, help="file for the page")
    return parser.parse_args(list(arguments))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
