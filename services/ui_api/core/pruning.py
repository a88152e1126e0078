"""What may be pruned, and what must be there afterwards: rules as values, no database and no files."""

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

CASE_PRUNED: Final = "case_pruned"
_SHA256: Final = re.compile(r"\b[0-9a-f]{64}\b")

Ranges = tuple[tuple[int, int], ...]


class PrunedEntries:
    """Entries of a log whose content is gone. Each must be announced by a later event, of the same case."""

    def __init__(self) -> None:
        self._unannounced: dict[int, str | None] = {}

    def see(self, sequence: int, case_id: str | None, kind: str, data_json: str) -> None:
        """Take in one entry after another, in the order of the log, each known to be intact."""
        if not data_json:
            self._unannounced[sequence] = case_id
        elif kind == CASE_PRUNED:
            told = json.loads(data_json)
            for first, last in told["event_ranges"]:
                for number in range(first, last + 1):
                    if self._unannounced.get(number) == told["pruned_case_id"]:
                        del self._unannounced[number]

    def unannounced(self) -> int | None:
        """Number of the first entry whose content is gone without a word; None when there is none."""
        return min(self._unannounced, default=None)


@dataclass(frozen=True, slots=True)
class LoggedEvent:
    """What the rules look at. `names` are all hashes in the event's data, of documents and images alike."""

    sequence: int
    case_id: str | None
    kind: str
    names: frozenset[str]


def hashes_in(data_json: str) -> frozenset[str]:
    """Every SHA-256 that an event's data names, at any depth and under any key."""
    return frozenset(_SHA256.findall(data_json))


def as_ranges(numbers: Iterable[int]) -> Ranges:
    """Numbers as ranges from the first to the last."""
    ranges: list[tuple[int, int]] = []
    for number in sorted(set(numbers)):
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1] = (ranges[-1][0], number)
        else:
            ranges.append((number, number))
    return tuple(ranges)


def only_named_by(events: Iterable[LoggedEvent], case_id: str) -> frozenset[str]:
    """Hashes that the events of a case name and no other event does."""
    own: set[str] = set()
    others: set[str] = set()
    for event in events:
        (own if event.case_id == case_id else others).update(event.names)
    return frozenset(own - others)
