"""The hash chain of the event log: each entry's hash covers its content and the hash before it.

So no entry can be changed, removed from the middle or put in later without breaking every hash after it. The chain
alone cannot show that its *end* was cut off: for that, compare the head's hash with one noted elsewhere (anchors).

What was pruned leaves its hashes: the chain goes on through them, and a later event must tell of it (`core.pruning`).
"""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass

from services.ui_api.core.pruning import PrunedEntries

# What the first event names as the one before it.
GENESIS_SHA256 = "0" * 64


@dataclass(frozen=True, slots=True)
class ChainEntry:
    """One entry as it is stored: `data_json` is the text that was hashed."""

    sequence: int
    at_ns: int
    case_id: str | None
    who: str
    why: str
    kind: str
    data_json: str
    previous_sha256: str
    sha256: str

    @property
    def is_pruned(self) -> bool:
        """Whether the content is gone; no event's JSON text is empty."""
        return not self.data_json


@dataclass(frozen=True, slots=True)
class ChainIntact:
    """The whole chain holds."""

    entries: int
    head_sha256: str


@dataclass(frozen=True, slots=True)
class ChainBroken:
    """The first entry at which the chain does not hold, and why, in one sentence."""

    sequence: int
    message: str


def entry_sha256(entry: ChainEntry) -> str:
    """Hash of an entry: SHA-256 of the canonical JSON of its content and the hash before it."""
    content = [
        entry.previous_sha256,
        entry.sequence,
        entry.at_ns,
        entry.case_id,
        entry.who,
        entry.why,
        entry.kind,
        entry.data_json,
    ]
    return hashlib.sha256(json.dumps(content, ensure_ascii=True, separators=(",", ":")).encode()).hexdigest()


def why_broken(entry: ChainEntry, number: int, previous_sha256: str) -> str | None:
    """Why an entry does not hold as the one of this number, after the one of that hash; None when it does."""
    if entry.sequence != number:
        return f"event {number} is missing: the log goes on with event {entry.sequence}"
    if entry.previous_sha256 != previous_sha256:
        return f"event {number} does not follow the event before it: its previous hash differs"
    if not entry.is_pruned and entry_sha256(entry) != entry.sha256:
        return f"event {number} ({entry.kind}) was changed: its content does not give its hash"
    return None


def check_chain(entries: Iterable[ChainEntry]) -> ChainIntact | ChainBroken:
    """Check a whole log, in the order of its sequence numbers, which count from 1 without gaps."""
    previous, count = GENESIS_SHA256, 0
    pruned = PrunedEntries()
    for count, entry in enumerate(entries, 1):
        if (message := why_broken(entry, count, previous)) is not None:
            return ChainBroken(count, message)
        pruned.see(entry.sequence, entry.case_id, entry.kind, entry.data_json)
        previous = entry.sha256
    if (unannounced := pruned.unannounced()) is not None:
        return ChainBroken(unannounced, f"event {unannounced} is empty, and no later event tells that it was pruned")
    return ChainIntact(count, previous)
