"""How severe, how probable, and what follows: the scales by which hazards are estimated (ISO 14971, 4.4 and 5.5)."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final


class Severity(StrEnum):
    """Of a harm, the least first."""

    NEGLIGIBLE = "negligible"
    MINOR = "minor"
    SERIOUS = "serious"
    CRITICAL = "critical"
    CATASTROPHIC = "catastrophic"


class Probability(StrEnum):
    """Of a harm in one procedure, the least first."""

    IMPROBABLE = "improbable"
    REMOTE = "remote"
    OCCASIONAL = "occasional"
    PROBABLE = "probable"
    FREQUENT = "frequent"


class Acceptance(StrEnum):
    """What follows from severity and probability."""

    ACCEPTABLE = "acceptable"
    REDUCE = "reduce"
    UNACCEPTABLE = "unacceptable"


SEVERITY_MEANS: Final[Mapping[Severity, str]] = {
    Severity.NEGLIGIBLE: "inconvenience",
    Severity.MINOR: "passes without treatment",
    Severity.SERIOUS: "needs treatment, such as a second hole in the bone",
    Severity.CRITICAL: "lasting damage",
    Severity.CATASTROPHIC: "death",
}
PROBABILITY_MEANS: Final[Mapping[Probability, str]] = {
    Probability.IMPROBABLE: "less than 1 in 1,000,000 procedures",
    Probability.REMOTE: "less than 1 in 10,000",
    Probability.OCCASIONAL: "less than 1 in 100",
    Probability.PROBABLE: "less than 1 in 10",
    Probability.FREQUENT: "more often",
}
ACCEPTANCE_MEANS: Final[Mapping[Acceptance, str]] = {
    Acceptance.ACCEPTABLE: "nothing further",
    Acceptance.REDUCE: "acceptable if no further control is practicable; what is left is stated",
    Acceptance.UNACCEPTABLE: "not acceptable: the check fails",
}
# One letter for each probability, the least first.
_MATRIX: Final[Mapping[Severity, str]] = {
    Severity.NEGLIGIBLE: "AAAAR",
    Severity.MINOR: "AAARR",
    Severity.SERIOUS: "ARRUU",
    Severity.CRITICAL: "ARUUU",
    Severity.CATASTROPHIC: "RUUUU",
}
_LETTERS: Final = {one.value[0].upper(): one for one in Acceptance}


def acceptance(severity: Severity, probability: Probability) -> Acceptance:
    """What follows, by the matrix."""
    return _LETTERS[_MATRIX[severity][list(Probability).index(probability)]]
