"""Declare acceptance criteria: what is measured, the limit, its unit, the code of the refusal, and the remedy.

Each service lists its criteria once, in its `core/acceptance.py`; `docs/refusals.md` is printed from them.
"""

from dataclasses import dataclass
from enum import StrEnum

from shared.errors import Reason, ReasonCode
from shared.figures import figure


class Sense(StrEnum):
    """On which side of the limit a measured value is acceptable."""

    AT_MOST = "at most"
    AT_LEAST = "at least"


@dataclass(frozen=True, slots=True)
class Criterion:
    """One reason for which an image, a pair of images, a fluoroscopy frame or a plan is refused.

    Attributes
    ----------
    code
        Stable code of the refusal.
    measured
        What is measured, as a noun phrase: "tilt of a hole's axis against its ray".
    limit, unit, sense
        Acceptable are values at most, or at least, the limit. NaN is never acceptable.
    decimals
        In which a measured value is printed; more are added where it would otherwise read as the limit.
    remedy
        What to do, as an imperative clause.
    origin
        Where the limit comes from.
    """

    code: ReasonCode
    measured: str
    limit: float
    unit: str
    sense: Sense
    decimals: int
    remedy: str
    origin: str

    def is_met(self, value: float) -> bool:
        """Whether a measured value is acceptable; NaN is not."""
        return bool(value <= self.limit if self.sense is Sense.AT_MOST else value >= self.limit)

    def printed(self, value: float) -> str:
        """A measured value with its unit."""
        return f"{figure(value, self.limit, self.decimals)}{self._unit}"

    @property
    def printed_limit(self) -> str:
        """The limit as sentences quote it: "limit 14°", "at least 12"."""
        word = "limit" if self.sense is Sense.AT_MOST else "at least"
        return f"{word} {self.limit:g}{self._unit}"

    @property
    def _unit(self) -> str:
        return self.unit if self.unit in {"", "°"} else f" {self.unit}"

    def reason(self, observation: str) -> Reason:
        """The refusal of an observation: "<observation> (limit ...); <remedy>"."""
        return Reason(self.code, f"{observation} ({self.printed_limit}); {self.remedy}")


@dataclass(frozen=True, slots=True)
class Finding:
    """A refusal without a numerical limit: something that must be there is not, or two things contradict each other.

    Attributes
    ----------
    observed
        When it applies, as a clause: "no pair of parallel edges has the nail's width".
    """

    code: ReasonCode
    observed: str
    remedy: str

    def reason(self, observation: str) -> Reason:
        """The refusal: "<observation>; <remedy>"."""
        return Reason(self.code, f"{observation}; {self.remedy}")
