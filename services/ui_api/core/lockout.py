"""When passwords are no longer tried: after failures of one account from one address. Pure.

Only the pair of account and address is locked. Who guesses a surgeon's password from the corridor locks himself out,
and not the surgeon at the console; nobody can lock everybody out.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

# Chosen: who mistypes gets a few tries; a guesser gets some hundred a day.
FREE_FAILURES: Final = 5
_FIRST_LOCK_S: Final = 30.0
_LONGEST_LOCK_S: Final = 900.0
# Failures count as long as this after the last of them.
_FORGET_AFTER_S: Final = 3600.0
# Pairs that are remembered; beyond it the one that failed longest ago is forgotten.
MOST_PAIRS: Final = 10_000

Pair = tuple[str, str]
"""Account and address."""


@dataclass(frozen=True, slots=True)
class Failures:
    """Failures in a row, and when the last one was, on a monotonic clock."""

    count: int
    last_s: float


def locked_for_s(failures: Failures | None, now_s: float) -> float:
    """How long no password is tried; 0 when one may be.

    The time doubles with every failure beyond `FREE_FAILURES`, from 30 s to 15 min.
    """
    if failures is None or failures.count < FREE_FAILURES:
        return 0.0
    doublings = min(failures.count - FREE_FAILURES, 10)
    lock_s = min(_FIRST_LOCK_S * 2.0**doublings, _LONGEST_LOCK_S)
    return max(0.0, failures.last_s + lock_s - now_s)


def after_failure(known: Mapping[Pair, Failures], pair: Pair, now_s: float) -> dict[Pair, Failures]:
    """All failures that still count, with one more; those of longest ago make room."""
    recent = {other: failures for other, failures in known.items() if now_s - failures.last_s < _FORGET_AFTER_S}
    before = recent.pop(pair, None)
    while len(recent) >= MOST_PAIRS:
        del recent[min(recent, key=lambda other: recent[other].last_s)]
    return {**recent, pair: Failures(1 if before is None else before.count + 1, now_s)}


def after_success(known: Mapping[Pair, Failures], pair: Pair) -> dict[Pair, Failures]:
    """All failures without those of a pair."""
    return {other: failures for other, failures in known.items() if other != pair}
