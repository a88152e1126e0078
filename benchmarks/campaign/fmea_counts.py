"""Frequencies for the FMEA: in how many procedures each step said no, by code, and how those procedures ended."""

from collections import Counter
from collections.abc import Sequence
from typing import TypedDict

from benchmarks.campaign.rows import CaseRow, Moment


class StepCounts(TypedDict):
    """Of one step.

    Attributes
    ----------
    procedures
        In which the step said no at least once.
    codes
        In how many of them each code was said.
    """

    procedures: int
    codes: dict[str, int]


class Counts(TypedDict):
    """Of the whole campaign.

    Attributes
    ----------
    errors, faults
        Of each, how the procedures with it ended.
    codes
        In how many procedures each code was said, at whatever step.
    """

    procedures: int
    endings: dict[str, int]
    errors: dict[str, dict[str, int]]
    faults: dict[str, dict[str, int]]
    codes: dict[str, int]
    steps: dict[str, StepCounts]


def counts_of(rows: Sequence[CaseRow]) -> Counts:
    """Count."""
    return {
        "procedures": len(rows),
        "endings": dict(Counter(row.ending.value for row in rows)),
        "errors": {name: _endings([r for r in rows if r.error == name]) for name in sorted({r.error for r in rows})},
        "faults": {name: _endings([r for r in rows if r.fault == name]) for name in sorted({r.fault for r in rows})},
        "codes": _in_procedures([{one.code for one in row.noticed} for row in rows]),
        "steps": {moment.value: _of_step(rows, moment) for moment in Moment},
    }


def _endings(rows: Sequence[CaseRow]) -> dict[str, int]:
    return dict(sorted(Counter(row.ending.value for row in rows).items()))


def _of_step(rows: Sequence[CaseRow], moment: Moment) -> StepCounts:
    said = [{one.code for one in row.noticed if one.moment is moment} for row in rows]
    return {"procedures": sum(bool(one) for one in said), "codes": _in_procedures(said)}


def _in_procedures(said: Sequence[set[str]]) -> dict[str, int]:
    return dict(sorted(Counter(code for one in said for code in one).items()))
