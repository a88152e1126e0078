"""Computations as operations: how far each has come, from its events. Pure."""

from dataclasses import dataclass, replace
from typing import Final

from services.ui_api.core.computation_event_data import (
    ComputationEnded,
    ComputationProgressed,
    ComputationRequested,
    ComputationStatus,
)

# Waits for its turn, is computed, is recorded.
STEPS: Final = 3
WAITS: Final = "waits for its turn"


@dataclass(frozen=True, slots=True)
class Computation:
    """Something that is computed while nobody waits for it.

    Attributes
    ----------
    step, says
        Which of the `STEPS` it is at, and what is done in it.
    result
        Path of what it made.
    """

    requested: ComputationRequested
    case_id: str | None
    requested_at_ns: int
    status: ComputationStatus = ComputationStatus.RUNNING
    step: int = 1
    says: str = WAITS
    code: str = ""
    message: str = ""
    result: str | None = None
    ended_at_ns: int | None = None

    @property
    def ended(self) -> bool:
        """Whether nothing more will come of it."""
        return self.status is not ComputationStatus.RUNNING


def progressed(computation: Computation, event: ComputationProgressed) -> Computation:
    """The computation after a `ComputationProgressed`."""
    return replace(computation, step=event.step, says=event.says)


def ended(computation: Computation, event: ComputationEnded, at_ns: int) -> Computation:
    """The computation after a `ComputationEnded`."""
    return replace(
        computation,
        status=event.status,
        code=event.code,
        message=event.message,
        result=event.result,
        ended_at_ns=at_ns,
    )
