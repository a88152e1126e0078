"""What a fault is, as a value: how it comes and goes, what may be seen meanwhile, and what must hold."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from benchmarks.faults.site import FaultSite

# From the fault to rest and locked, whatever dies while the robot moves.
SAFE_WITHIN_S: Final = 0.5
SAFE_WITHIN_MM: Final = 1.0
# From the fault on, until `readyz` must have noticed: a service is silent after 2 s, a probe of disk and database takes
# up to 2 s and lasts 0.5 s.
NOTICED_WITHIN_S: Final = 4.5


class Readiness(StrEnum):
    """What `readyz` may say while a fault lasts, once it must have noticed."""

    NEVER = "never ready"
    ANY = "ready or not"


class InMotion(StrEnum):
    """What becomes of a motion when a fault comes."""

    STOPS = "stops"
    MAY_FINISH = "stops, or goes on under supervision to its target"
    UNREACHABLE = (
        "goes on to its target and is held there, for nothing reaches the controller; locked once it is reached"
    )


class Answers(StrEnum):
    """What a request that acts may get while a fault lasts."""

    GOES_ON = "the procedure goes on as if nothing were"
    REFUSES = "goes on, or a sentence that says why not"
    SILENT = "the same, or nothing: what would answer is gone"


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that goes wrong, and is mended again.

    Attributes
    ----------
    name
        Row of the table.
    injected
        The fault comes when the context is entered, and goes when it is left.
    may_end
        Processes that may end by themselves with an error; whoever supervises them starts them again.
    held_s
        How long it lasts at least.
    needs_mounts
        Whether it needs disks of its own (`small_disks`).
    """

    name: str
    injected: Callable[[FaultSite], AbstractContextManager[None]]
    readiness: Readiness = Readiness.ANY
    in_motion: InMotion = InMotion.MAY_FINISH
    answers: Answers = Answers.REFUSES
    may_end: frozenset[str] = frozenset()
    held_s: float = 1.0
    needs_mounts: bool = False

    @property
    def lasts_s(self) -> float:
        """How long it lasts: so long that `readyz` must have noticed, and some time more."""
        return max(self.held_s, NOTICED_WITHIN_S + 1.0) if self.readiness is Readiness.NEVER else self.held_s
