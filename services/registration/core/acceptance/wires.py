"""Acceptance of images with wires in front of the nail, and of the wires' axes: every limit."""

from typing import Final

from services.registration.core.acceptance.image import BEST_OPENING, Openings
from shared.acceptance import Criterion, at_least
from shared.errors import ReasonCode

_RECORD: Final = "docs/decisions/0013-wires.md"

BEST_OPENING_BESIDE_WIRES: Final = Criterion(
    code=ReasonCode.HOLE_NOT_VISIBLE,
    measured="visible share of the disc of the hole that shows most beside its wire",
    limit=at_least(0.15, "%", decimals=0),
    remedy=BEST_OPENING.remedy,
    origin=f"fitted by inspection ({_RECORD}): what a wire leaves of a hole is judged by the pose's covariance",
)
OTHER_OPENING_BESIDE_WIRES: Final = Criterion(
    code=ReasonCode.HOLE_NOT_VISIBLE,
    measured="visible share of the disc of every other hole beside its wire",
    limit=at_least(0.1, "%", decimals=0),
    remedy=BEST_OPENING.remedy,
    origin=f"fitted by inspection ({_RECORD}): the spacing of the holes is measured and not only assumed",
)
BESIDE_WIRES: Final = Openings(BEST_OPENING_BESIDE_WIRES, OTHER_OPENING_BESIDE_WIRES)
