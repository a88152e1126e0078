"""What is kept of each race, and of an installation's record the part that belongs to one race."""

import json
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from benchmarks.gateway.race_judgement import Answer, Recorded
from benchmarks.gateway.race_room import PlansFrom
from services.ui_api.core.chain import ChainIntact
from services.ui_api.record.database import existing_database
from services.ui_api.record.location import sqlite_url
from services.ui_api.record.verify import verify_record


@dataclass(frozen=True, slots=True)
class AnswerRow:
    """What was asked and answered, without the words."""

    surgeon: str
    action: str
    status: int
    code: str

    @staticmethod
    def of(answer: Answer) -> "AnswerRow":
        """The part that is kept."""
        return AnswerRow(answer.surgeon, answer.action, answer.status, answer.code)


@dataclass(frozen=True, slots=True)
class RaceRow:
    """One race.

    Attributes
    ----------
    motions, stops
        Commands that went to the controller.
    took_s
        From making the robot ready to the last judgement.
    """

    number: int
    plans_from: PlansFrom
    answers: tuple[AnswerRow, ...]
    motions: int
    stops: int
    faults: tuple[str, ...]
    took_s: float

    @property
    def with_stop(self) -> bool:
        """Whether a stop was confirmed in it."""
        return any(one.action == "stop" and one.status < 300 for one in self.answers)


class RecordTail:
    """Reads an installation's record from outside: what has come since it was read last, and whether it verifies."""

    def __init__(self, state_dir: Path) -> None:
        self._url = sqlite_url(state_dir)
        self._sequence = -1
        self.pass_over()

    def pass_over(self) -> None:
        """From now on only what comes now."""
        with closing(self._connection()) as connection:
            self._sequence = connection.execute("SELECT coalesce(max(sequence), -1) FROM events").fetchone()[0]

    def events(self) -> list[Recorded]:
        """The events that count, since it was last passed over."""
        with closing(self._connection()) as connection:
            rows = connection.execute(
                "SELECT kind, data_json FROM events WHERE sequence > ? ORDER BY sequence", (self._sequence,)
            ).fetchall()
        return [_recorded(kind, json.loads(data_json)) for kind, data_json in rows]

    def chain_faults(self) -> list[str]:
        """What is wrong with the record's chain."""
        engine = existing_database(self._url)
        try:
            verdict = verify_record(engine)
        finally:
            engine.dispose()
        return [] if isinstance(verdict, ChainIntact) else [f"the record's chain: {verdict}"]

    def _connection(self) -> sqlite3.Connection:
        return sqlite3.connect(self._url.removeprefix("sqlite:///"))


def _recorded(kind: str, data: dict[str, object]) -> Recorded:
    plan, verb = data.get("plan_number", data.get("number")), data.get("verb")
    return Recorded(kind, plan if isinstance(plan, int) else None, verb if isinstance(verb, str) else None)
