"""Which combinations are tried in which order: passes through the procedure, with another fault at each step."""

import random
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass

from benchmarks.faults.declaration import Fault
from benchmarks.faults.patient import STEPS, Step


@dataclass(frozen=True, slots=True)
class Planned:
    """A fault at a step."""

    fault: Fault
    step: Step

    @property
    def key(self) -> str:
        """Names the combination in a file of findings."""
        return f"{self.fault.name} @ {self.step}"


Pass = tuple[Planned, ...]


def passes(faults: Sequence[Fault], seed: int) -> list[Pass]:
    """As many passes as there are faults, which together have every fault once at every step.

    The seed decides the order; the first passes are a fair sample of all combinations.
    """
    order = list(faults)
    random.Random(seed).shuffle(order)
    return [
        tuple(Planned(order[(number + place) % len(order)], step) for place, step in enumerate(STEPS))
        for number in range(len(order))
    ]


def without(planned: Sequence[Pass], done: AbstractSet[str]) -> list[Pass]:
    """The passes that are left when some combinations have been tried."""
    left = [tuple(one for one in each if one.key not in done) for each in planned]
    return [each for each in left if each]
