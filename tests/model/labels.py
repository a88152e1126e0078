"""Names and numbers as the model writes them: few classes in place of counters and clocks that never repeat.

Only the order of numbers and the age of times decide anything in the code that runs, and identifiers are compared for
equality alone. So a state needs no clock reading and no counter, only the class of each; `load` turns a class into a
value that stands for it, and `save` finds the class again.
"""

from collections.abc import Callable
from enum import IntEnum
from typing import Final, TypeAlias

from services.robot.core.deviation import Deviation
from services.robot.core.guard_context import GuardLimits

# The clock stands still while code runs; time passes by a step of its own, which makes everything else older.
NOW_S: Final = 1000.0
PERIOD_S: Final = 5.0  # longer than any command or permit lives, shorter than any plan does
UNHEARD_S: Final = 0.3  # longer than the gateway may be silent, shorter than any command lives
LIMITS: Final = GuardLimits(Deviation(20.0, 12.0), 600.0, 0.2, 1.0)

THIS_BOOT: Final = "boot-now"
EARLIER_BOOT: Final = "boot-before"
GATEWAY: Final = "gateway-now"
EARLIER_GATEWAY: Final = "gateway-before"
CASE: Final = "case1"
SLOTS: Final = "abcdefghij"


class Quote(IntEnum):
    """A state of the robot that somebody has seen, by when the robot published it."""

    NEW = 0
    OLD = 1  # from before time passed once
    BEFORE_STOP = 2  # as `NEW`, but a stop has come since
    OLD_BEFORE_STOP = 3  # as `OLD`, but a stop has come since
    OLDER = 4

    @property
    def sequence(self) -> int:
        """Its number while code runs; a state that is published now gets the next after `NEW`."""
        return 100 - 10 * self

    @property
    def published_s(self) -> float:
        """When it was published, while code runs."""
        return NOW_S - (0, 1, 0, 1, 2)[self] * PERIOD_S

    @property
    def is_late(self) -> bool:
        """Whether a command that quotes it comes too late."""
        return self.published_s < NOW_S

    @property
    def is_before_stop(self) -> bool:
        """Whether a stop has come since."""
        return self > Quote.OLD

    def later(self) -> "Quote":
        """After time has passed."""
        return (Quote.OLD, Quote.OLDER, Quote.OLD_BEFORE_STOP, Quote.OLDER, Quote.OLDER)[self]

    def after_stop(self) -> "Quote":
        """After a stop."""
        return {Quote.NEW: Quote.BEFORE_STOP, Quote.OLD: Quote.OLD_BEFORE_STOP}.get(self, self)


QuoteChange: TypeAlias = Callable[[Quote], Quote]


def quote_of(sequence: int) -> Quote:
    """The class of a number that `Quote.sequence` gave, or that was counted on from there."""
    return next(q for q in Quote if sequence >= q.sequence)
