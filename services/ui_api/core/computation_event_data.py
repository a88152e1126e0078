"""What events of computations say: what a client began without waiting for it, and may cancel."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

ComputationVerb = Literal["verify", "report_quality", "plan"]


class ComputationStatus(StrEnum):
    """How far a computation has come."""

    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True)
class ComputationRequested:
    """A verification, a quality report or a plan is computed while nobody waits for it. `says` is what, in words."""

    operation_id: str
    verb: ComputationVerb
    says: str


@dataclass(frozen=True, slots=True)
class ComputationProgressed:
    """A computation is at another of its steps, which `says` names."""

    operation_id: str
    step: int
    says: str


@dataclass(frozen=True, slots=True)
class ComputationEnded:
    """A computation is over: `result` is the path of what it made; a cancelled one has made nothing."""

    operation_id: str
    status: ComputationStatus
    code: str
    message: str
    result: str | None = None
