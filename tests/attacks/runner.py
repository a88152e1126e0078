"""Tries one attack: was it refused as declared, is that on record, and did the robot stay where it was?"""

import re
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from distalock.client import RequestRefused
from tests.attacks.attack import Attack, Record
from tests.attacks.site import Site, wait_until

RECORDED_WITHIN_S = 5.0


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of an attack; `seen` is a sentence for people."""

    attack: Attack
    held: bool
    seen: str


def tried(attack: Attack, site: Site) -> Verdict:
    """Try an attack, and look at the system after it."""
    before, ends = site.true_pose(), log_ends(site)
    seen = attack.run(site)
    wrong = [] if seen == attack.refusal else [f"expected '{attack.refusal}'"]
    if attack.record is not None and not is_recorded(attack.record, site, ends):
        wrong.append(f"'{attack.record.text}' is not in the log of {attack.record.log}")
    if site.true_pose() != before:
        wrong.append("the robot moved")
    if (unready := why_unready(site)) is not None:
        wrong.append(unready)
    return Verdict(attack, not wrong, "; ".join([seen, *wrong]))


def log_ends(site: Site) -> dict[Path, int]:
    """How long each log is now; of the case record, the number of its newest event."""
    return {file: _end(file) for file in (*site.log_files(), site.case_record)}


def is_recorded(record: Record, site: Site, ends: dict[Path, int]) -> bool:
    """Whether a process has logged a text since then, or the case record has such an event."""
    files = [file for file in (*site.log_files(), site.case_record) if file.stem == record.log]
    try:
        wait_until(
            lambda: any(re.search(record.text, _since(file, ends.get(file, 0))) for file in files),
            record.text,
            RECORDED_WITHIN_S,
        )
    except TimeoutError:
        return False
    return True


def why_unready(site: Site) -> str | None:
    """What the gateway misses after an attack; None when it is as ready as before."""
    try:
        wait_until(lambda: _is_ready(site), "ready")
    except TimeoutError:
        return "the system is not ready any more"
    return None


def _is_ready(site: Site) -> bool:
    try:
        return site.ready()
    except RequestRefused:
        return False


def _end(file: Path) -> int:
    if file.suffix != ".sqlite":
        return file.stat().st_size
    return int(_events(file, "SELECT max(sequence) FROM events")[0])


def _since(file: Path, start: int) -> str:
    if file.suffix == ".sqlite":
        return "\n".join(_events(file, f"SELECT kind || data_json FROM events WHERE sequence > {start}"))
    with file.open("rb") as log:
        log.seek(start)
        return log.read().decode(errors="replace")


def _events(file: Path, query: str) -> list[str]:
    with closing(sqlite3.connect(f"file:{file}?mode=ro", uri=True)) as record:
        return [str(row[0]) for row in record.execute(query)]
