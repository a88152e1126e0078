"""Acceptance of a plan: why no move is planned. What the robot's guard checks of a plan stands in the robot service."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from shared.acceptance import Criterion, Finding, at_most


class PlanRefusal(StrEnum):
    """Why there is no plan."""

    UNKNOWN_HOLE = "unknown_hole"
    UNKNOWN_UNCERTAINTY = "unknown_uncertainty"
    UNEQUAL_SPACING = "unequal_spacing"
    OUT_OF_REACH = "out_of_reach"


@dataclass(frozen=True, slots=True)
class PlanRefused:
    """No plan, and why: code and one sentence with the measured value, its limit and the remedy."""

    code: PlanRefusal
    message: str


UNKNOWN_HOLE: Final = Finding(
    code=PlanRefusal.UNKNOWN_HOLE,
    observed="a hole is asked for twice or not shared by guide and nail, or none is asked for",
    remedy="name holes that guide and nail share, each once",
)
UNKNOWN_UNCERTAINTY: Final = Finding(
    code=PlanRefusal.UNKNOWN_UNCERTAINTY,
    observed="the localisation does not estimate its own errors (method fronto-parallel)",
    remedy="localise with the model method",
)
RESIDUAL: Final = Criterion(
    code=PlanRefusal.UNEQUAL_SPACING,
    measured="largest offset that remains between guide and nail axes when several are aligned at once",
    limit=at_most(0.25, "mm", decimals=2),
    remedy="plan one hole per move",
    origin="required: a quarter of the largest error at a hole's entry",
)
OUT_OF_REACH: Final = Finding(
    code=PlanRefusal.OUT_OF_REACH,
    observed="the hexapod cannot bring the guide onto the axes within the limits of legs and joints",
    remedy="remount the robot so that the guide starts nearer to the axes",
)


def refused(criterion: Criterion[PlanRefusal] | Finding[PlanRefusal], observation: str) -> PlanRefused:
    """No plan for this reason: "<observation>; <remedy>"."""
    return PlanRefused(criterion.code, f"{observation}; {criterion.remedy}")
