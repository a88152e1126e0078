"""What was looked at, what was measured, and what to do about it."""

from dataclasses import dataclass
from enum import StrEnum


class Verdict(StrEnum):
    """How it stands with one thing."""

    WELL = "well"
    ATTENTION = "attention"  # works, but not as it should, or not for long
    WRONG = "wrong"
    UNKNOWN = "not looked at"


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the report.

    Attributes
    ----------
    remedy
        What to do; empty where nothing is to be done.
    """

    name: str
    verdict: Verdict
    measured: str
    remedy: str = ""


def well(name: str, measured: str) -> Finding:
    """As it should be."""
    return Finding(name, Verdict.WELL, measured)


def attention(name: str, measured: str, remedy: str) -> Finding:
    """To be seen to before it hurts."""
    return Finding(name, Verdict.ATTENTION, measured, remedy)


def wrong(name: str, measured: str, remedy: str) -> Finding:
    """Keeps a procedure from going well."""
    return Finding(name, Verdict.WRONG, measured, remedy)


def unknown(name: str, why: str, remedy: str = "") -> Finding:
    """Could not, or must not, be looked at now."""
    return Finding(name, Verdict.UNKNOWN, why, remedy)


def of_running(part: str, measured: str, remedy: str, *, does_its_work: bool) -> Finding:
    """What a running gateway says of a part that a procedure needs: one that is well may have a remedy too."""
    name = f"running: {part.replace('_', ' ')}"
    verdict = Verdict.WRONG if not does_its_work else Verdict.ATTENTION if remedy else Verdict.WELL
    return Finding(name, verdict, measured, remedy)
