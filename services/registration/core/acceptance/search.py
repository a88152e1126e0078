"""Limits of the searches for the drill guide and the nail in one image, which quote them where they refuse."""

from typing import Final

from shared.acceptance import Criterion, Finding, at_least, at_most
from shared.errors import ReasonCode

_INSPECTION: Final = "fitted by inspection on seeded scenes of `benchmarks.scenes.random_scenes`"

# The drill guide

GUIDE_IDENTITY: Final = Criterion(
    code=ReasonCode.GUIDE_NOT_FOUND,
    measured="discs outside the ring that fit the guide's pattern of balls",
    limit=at_least(7.0, "", decimals=0),
    depends="as many as must be measured while other positions explain nearly as many",
    remedy="check that the drill guide is in the image and that the guide file is that of this guide, and take one "
    "more image",
    origin="derived: a wrong guide file explains a few discs by chance",
)
GUIDE_MARGIN: Final = Criterion(
    code=ReasonCode.GUIDE_AMBIGUOUS,
    measured="discs that the best position of the guide explains beyond the next different one",
    limit=at_least(3.0, "", decimals=0),
    remedy="turn the C-arm a few degrees so that fewer balls are covered and take one more image",
    origin=_INSPECTION,
)
GUIDE_BALLS: Final = Criterion(
    code=ReasonCode.GUIDE_TOO_FEW_BALLS,
    measured="balls of the guide that could be measured",
    limit=at_least(12.0, "", decimals=0),
    depends="or 40 % of the guide's balls if that is more; all but two of a guide with few balls",
    remedy="check that the guide file is that of this guide, uncover the balls by turning the C-arm a few degrees and "
    "take one more image",
    origin=_INSPECTION,
)

# The nail

NAIL_BAND: Final = Finding(
    code=ReasonCode.NAIL_NOT_FOUND,
    observed="no dark band of the nail's width is in the image",
    remedy="bring the nail's distal end into view, or check the nail file",
)
SEARCHED_OPENNESS: Final = Criterion(
    code=ReasonCode.HOLE_NOT_VISIBLE,
    measured="contrast of the least visible hole against the nail's band, as a share of the band's own",
    limit=at_least(0.3, "", decimals=2),
    remedy="turn the C-arm until all holes look open",
    origin=_INSPECTION,
)
DIRECTION_MARGIN: Final = Criterion(
    code=ReasonCode.NAIL_NOT_FOUND,
    measured="evidence for the nail's distal end over that for the other end, without a drill guide in view",
    limit=at_least(0.3, "", decimals=2),
    remedy="bring the nail's tip or the drill guide into view",
    origin=_INSPECTION,
)
DIRECTION_CONTRADICTION: Final = Criterion(
    code=ReasonCode.NAIL_MODEL_MISMATCH,
    measured="evidence for a distal end of the nail opposite to the one that the drill guide gives",
    limit=at_most(0.5, "", decimals=2),
    remedy="check the nail file's tip_x_mm and how the guide is mounted",
    origin=_INSPECTION,
)
SEARCHED_OUTLINE: Final = Criterion(
    code=ReasonCode.HOLE_NOT_VISIBLE,
    measured="visible length of a hole's outline",
    limit=at_least(0.35, "%", decimals=0),
    remedy="turn the C-arm, or move the guide's balls off the hole",
    origin=_INSPECTION,
)
BAND_WIDTH: Final = Criterion(
    code=ReasonCode.NAIL_MODEL_MISMATCH,
    measured="width of the nail's band against that of the filed nail with holes at this depth",
    limit=at_most(0.07, "%", decimals=0),
    remedy="check the nail file",
    origin=_INSPECTION,
)
