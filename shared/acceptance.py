"""Declare acceptance criteria: what is measured, the limit, its unit, the code of the refusal, and the remedy.

Each service lists its criteria once, under `core/acceptance`; `docs/refusals.md` is printed from them.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, TypeVar

from shared.errors import Reason, ReasonCode
from shared.figures import figure, figures

CodeT = TypeVar("CodeT", bound=StrEnum)


class Sense(StrEnum):
    """On which side of the limit a measured value is acceptable; "limit" and "at least" are how sentences quote it."""

    AT_MOST = "limit"
    AT_LEAST = "at least"


@dataclass(frozen=True, slots=True)
class Limit:
    """The largest or least acceptable value.

    Attributes
    ----------
    value, unit
        With the unit "%", limit and measured values are fractions and only printed as percentages.
    decimals
        In which a measured value is printed; more are added where it would otherwise read as the limit.
    """

    value: float
    unit: str
    sense: Sense
    decimals: int

    def __str__(self) -> str:
        """The value with its unit: "14°", "35 %"."""
        return self.with_unit(self.number)

    @property
    def number(self) -> str:
        """The value without its unit, as it is printed."""
        return f"{round(self.scale * self.value, 9):g}"

    @property
    def scale(self) -> float:
        """Factor from values to what is printed."""
        return 100.0 if self.unit == "%" else 1.0

    def with_unit(self, number: str) -> str:
        """A printed number with the unit behind it."""
        return f"{number}{self.unit}" if self.unit in {"", "°"} else f"{number} {self.unit}"


def at_most(value: float, unit: str, decimals: int) -> Limit:
    """Acceptable are values up to this one."""
    return Limit(value, unit, Sense.AT_MOST, decimals)


def at_least(value: float, unit: str, decimals: int) -> Limit:
    """Acceptable are values from this one on."""
    return Limit(value, unit, Sense.AT_LEAST, decimals)


@dataclass(frozen=True, slots=True)
class Refusal(Generic[CodeT]):
    """Why something is not done: stable code, and one sentence with the measured value, its limit and the remedy."""

    code: CodeT
    message: str


@dataclass(frozen=True, slots=True)
class Criterion(Generic[CodeT]):
    """One measured quantity for which an image, a pair of images, a fluoroscopy frame or a plan is refused.

    Attributes
    ----------
    code
        Stable code of the refusal.
    measured
        What is measured, as a noun phrase: "tilt of a hole's axis against its ray".
    limit
        Which values are acceptable; NaN never is.
    remedy
        What to do, as an imperative clause.
    origin
        Where the limit comes from.
    depends
        How the limit that applies follows from the case where it is not the same number for all.
    """

    code: CodeT
    measured: str
    limit: Limit
    remedy: str
    origin: str
    depends: str = ""

    def is_met(self, value: float, limit: float | None = None) -> bool:
        """Whether a measured value is acceptable; NaN is not. `limit` replaces one that depends on the case."""
        bound = self.limit.value if limit is None else limit
        return bool(value <= bound if self.limit.sense is Sense.AT_MOST else value >= bound)

    def quoted(self, value: float, limit: float | None = None, sign: str = "") -> str:
        """A measured value and the limit, as sentences quote them: "14.1° (limit 14°)", "10 % (at least 12 %)"."""
        of, scale = self.limit, self.limit.scale
        if limit is None:
            measured, bound = figure(scale * value, scale * of.value, of.decimals, sign), str(of)
        else:
            measured, bound = figures(scale * value, scale * limit, of.decimals)
            bound = of.with_unit(bound)
        return f"{of.with_unit(measured)} ({of.sense} {bound})"

    def reason(self: "Criterion[ReasonCode]", observation: str, remedy: str = "") -> Reason:
        """The refusal of an image: "<observation, which quotes value and limit>; <remedy>"."""
        return Reason(self.code, f"{observation}; {remedy or self.remedy}")

    def refusal(self, observation: str) -> Refusal[CodeT]:
        """The refusal of a plan: "<observation, which quotes value and limit>; <remedy>"."""
        return Refusal(self.code, f"{observation}; {self.remedy}")


@dataclass(frozen=True, slots=True)
class Finding(Generic[CodeT]):
    """A refusal without a numerical limit: something that must be there is not, or two things contradict each other.

    Attributes
    ----------
    code
        Stable code of the refusal.
    observed
        When it applies, as a clause: "no pair of parallel edges has the nail's width".
    remedy
        What to do, as an imperative clause.
    """

    code: CodeT
    observed: str
    remedy: str

    def reason(self: "Finding[ReasonCode]", observation: str = "", remedy: str = "") -> Reason:
        """The refusal of an image: "<observation>; <remedy>"."""
        return Reason(self.code, f"{observation or self.observed}; {remedy or self.remedy}")

    def refusal(self, observation: str = "") -> Refusal[CodeT]:
        """The refusal of a plan: "<observation>; <remedy>"."""
        return Refusal(self.code, f"{observation or self.observed}; {self.remedy}")
