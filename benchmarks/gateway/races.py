"""Two surgeons approve, move, take back and stop at once: one motion, one record, clear answers.

usage: distalock bench races [--races 500] [--seed 1] [--minutes 120] [--report FILE]

A real installation with the virtual operating room. For each race there is a plan that would move the robot by some
millimetres. Two surgeons, each with an account and a session of his own, play seeded scripts against it at the same
time; some requests are sent twice under one key. What came of it is judged by the answers, by what went over the
controller's line, by the room's own truth, and at the end by the record.
"""

import argparse
import json
import os
import random
import sqlite3
import sys
import time
from collections import Counter
from collections.abc import Container, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from threading import Barrier, Thread
from typing import Final

from benchmarks.common.places import PAGES, ROOT
from benchmarks.gateway.race_judgement import Answer, Race, Recorded, faults_of, record_faults
from benchmarks.gateway.race_room import RaceRoom, race_room
from benchmarks.gateway.surgeons import Surgeon, new_surgeon, script, sign_in
from distalock.arguments import seed_number, whole_number, writable_file
from services.ui_api.core.chain import ChainIntact
from services.ui_api.record.database import existing_database
from services.ui_api.record.location import sqlite_url
from services.ui_api.record.verify import verify_record
from shared.arguments import OneLineParser

REPORT: Final = PAGES / "races.md"
RACES: Final = 500
SEED: Final = 1
MINUTES: Final = 120
SCENARIO: Final = 1
NAMES: Final = ("anna", "boris")
_DOCUMENTS: Final = ("rest.md", "procedure.md", "refusals.md")
_RENEW_AFTER_S: Final = 600.0
_MOST_SHOWN: Final = 20
_FAULTS_ARE: Final = """A fault is one of these:
- a second motion to the controller from one plan, or one that no operation says to have begun;
- a motion to the controller after a stop's byte; a robot that moves, or has no stop in force, after a stop was answered
  200; a stop that was answered otherwise;
- a repeat under the same key that gets another answer;
- a refusal other than 409 and 412, without a reason, or with a code that is on no page;
- a motion on record without an approval in force; an answer of success without its event, or the other way round;
- a chain that does not verify.
"""


@dataclass(slots=True)
class Tally:
    """What came of all races."""

    races: int = 0
    motions: int = 0
    stops_won: int = 0
    answers: list[Answer] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)


class DocumentedCodes:
    """The codes of refusals that the documents name."""

    def __init__(self, folder: Path = ROOT / "docs") -> None:
        self._text = "\n".join((folder / name).read_text() for name in _DOCUMENTS)

    def __contains__(self, code: object) -> bool:
        return f"`{code}`" in self._text


def run_races(room: RaceRoom, races: int, seed: int, minutes: int) -> Tally:
    """So many races, one after another; fewer when the time is over."""
    rest, url = room.room.rest, room.room.installation.ports.rest_url
    surgeons = [new_surgeon(rest, url, name, room.case.id) for name in NAMES]
    tally, moved, began_s = Tally(), True, time.monotonic()
    signed_in_s = began_s
    for number in range(races):
        if time.monotonic() - began_s > 60.0 * minutes:
            break
        if time.monotonic() - signed_in_s > _RENEW_AFTER_S:
            for surgeon in surgeons:
                sign_in(surgeon)
            signed_in_s = time.monotonic()
        race = _run(room, surgeons, random.Random(f"{seed}-{number}"), moved=moved)
        moved = any(one.what == "move" for one in race.commanded)
        _count(tally, race, number, DocumentedCodes())
    return tally


def _run(room: RaceRoom, surgeons: Sequence[Surgeon], source: random.Random, *, moved: bool) -> Race:
    plan = room.plan(source, moved=moved)
    room.line.taken()
    start = Barrier(len(surgeons))
    threads = []
    for surgeon in surgeons:
        surgeon.answers.clear()
        arguments = (script(source), plan.number, f'"{plan.sha256}"', start)
        threads.append(Thread(target=surgeon.play, args=arguments, daemon=True))
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    operations = room.operations(plan.number)
    answers = tuple(answer for surgeon in surgeons for answer in surgeon.answers)
    return Race(answers, room.line.taken(), operations, room.stop_is_latched(), room.is_at_rest())


def _count(tally: Tally, race: Race, number: int, documented: Container[str]) -> None:
    tally.races += 1
    tally.motions += sum(one.what == "move" for one in race.commanded)
    tally.stops_won += any(one.action == "stop" and one.succeeded for one in race.answers)
    tally.answers += race.answers
    found = [f"race {number}: {fault}" for fault in faults_of(race, documented)]
    tally.faults += found
    for line in found:
        print(line, flush=True)
    if (number + 1) % 10 == 0:
        print(f"{number + 1} races, {tally.motions} motions, {len(tally.faults)} faults", flush=True)


def recorded(state_dir: Path) -> list[Recorded]:
    """The events of the record that count here."""
    with closing(sqlite3.connect(sqlite_url(state_dir).removeprefix("sqlite:///"))) as connection:
        rows = connection.execute("SELECT kind, data_json FROM events ORDER BY sequence").fetchall()
    found = []
    for kind, data_json in rows:
        data = json.loads(data_json)
        found.append(Recorded(kind, data.get("plan_number", data.get("number")), data.get("verb")))
    return found


def main(arguments: Sequence[str] = ()) -> int:
    """Run, write the page; 1 when anything is wrong."""
    given = _options(arguments)
    began_s = time.monotonic()
    with race_room(SCENARIO) as room:
        tally = run_races(room, given.races, given.seed, given.minutes)
        state_dir = room.room.installation.state_dir
        tally.faults += record_faults(recorded(state_dir), tally.answers)
        engine = existing_database(sqlite_url(state_dir))
        verdict = verify_record(engine)
        engine.dispose()
    if not isinstance(verdict, ChainIntact):
        tally.faults.append(f"the record's chain: {verdict}")
    page = page_of(tally, given.seed, time.monotonic() - began_s)
    given.report.write_text(page)
    print(page)
    return 1 if tally.faults else 0


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = OneLineParser(prog="distalock bench races", description="two surgeons at once")
    parser.add_argument("--races", type=whole_number("a number of races", 1, 10**5), default=RACES, help=f"({RACES})")
    parser.add_argument("--seed", type=seed_number, default=SEED, help=f"of the scripts ({SEED})")
    minutes = whole_number("minutes", 1, 10**4)
    parser.add_argument("--minutes", type=minutes, default=MINUTES, help=f"after which no race begins ({MINUTES})")
    parser.add_argument("--report", type=writable_file, default=REPORT, help="file for the page")
    return parser.parse_args(list(arguments))


def page_of(tally: Tally, seed: int, took_s: float) -> str:
    """The page."""
    counts = Counter((one.action, one.status, one.code) for one in tally.answers)
    rows = "".join(
        f"| {action} | {status} | {f'`{code}`' if code else ''} | {count} |\n"
        for (action, status, code), count in sorted(counts.items())
    )
    listed = "".join(f"- {fault}\n" for fault in tally.faults[:_MOST_SHOWN]) or "None.\n"
    return (
        "# Two surgeons at once\n\n"
        f"Made by `distalock bench races --races {tally.races} --seed {seed}` in {took_s / 60.0:.0f} min: a real "
        "installation with the virtual operating room, two surgeons\nwith accounts and sessions of their own, seeded "
        "scripts of approving, moving, taking back and stopping against one plan at the same time,\nsome requests "
        "twice under one key.\n\n"
        "| races | requests | motions | races with a stop | faults |\n|---|---|---|---|---|\n"
        f"| {tally.races} | {len(tally.answers)} | {tally.motions} | {tally.stops_won} "
        f"| {len(tally.faults)} (limit 0) |\n\n{_FAULTS_ARE}\n"
        f"| request | answer | code | times |\n|---|---|---|---|\n{rows}\n"
        f"## Faults\n\n{listed}\n"
        f"Load average of the five minutes before the end of this run: {os.getloadavg()[1]:.1f}, "
        f"on {os.cpu_count()} processors.\n"
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
