"""What must be there after pruning: each event whose content is gone is announced by a later one."""

import json
from typing import Final

CASE_PRUNED: Final = "case_pruned"


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
