"""Every criterion by which imaging refuses an image or its calibration; `docs/refusals.md` lists them."""

from typing import Final

from shared.acceptance import Criterion, Finding, at_least, at_most
from shared.errors import ReasonCode

_BY_INSPECTION: Final = "chosen by inspection on seeded images"
_EXPOSURE: Final = "lower the exposure or collimate and take another image"
_UNCOVER_THE_MIDDLE: Final = "uncover the ring around the middle and take another image"
_CHECK_THE_RING: Final = (
    "check that the ring is mounted, that its file is the right one and that the nominal C-arm values are within 10 %"
)

IMAGE_SIDE: Final = Criterion(
    code=ReasonCode.IMAGE_UNUSABLE,
    measured="shorter side of the image",
    limit=at_least(256, "px", decimals=0),
    remedy="send the full image",
    origin="smaller images are thumbnails: C-arms have 512 pixels and more",
)
GREY_LEVELS: Final = Criterion(
    code=ReasonCode.IMAGE_UNUSABLE,
    measured="number of different grey values",
    limit=at_least(16, "", decimals=0),
    remedy="check exposure and collimation and take another image",
    origin="four bits: fewer show no edges of balls",
)
NOT_FINITE: Final = Finding(
    code=ReasonCode.IMAGE_UNUSABLE,
    observed="the image holds values that are not finite numbers",
    remedy="send it again",
)
INVERTED: Final = Finding(
    code=ReasonCode.IMAGE_UNUSABLE,
    observed="the ring's balls are brighter than their surroundings, and no tag marks the image as inverted",
    remedy="switch the C-arm's display to dark metal and send it again",
)
CLIPPED: Final = Criterion(
    code=ReasonCode.SATURATED,
    measured="share of the image that is pure black or white",
    limit=at_most(0.6, "%", decimals=0),
    remedy=_EXPOSURE,
    origin=_BY_INSPECTION,
)
CLIPPED_WITHOUT_RING: Final = Criterion(
    code=ReasonCode.SATURATED,
    measured="share of the image that is pure black or white, where the ring was not found",
    limit=at_most(0.2, "%", decimals=0),
    remedy=_EXPOSURE,
    origin=_BY_INSPECTION,
)
RING_BALLS_IDENTIFIED: Final = Criterion(
    code=ReasonCode.RING_NOT_FOUND,
    measured="number of dark discs that fit the ring's pattern",
    limit=at_least(16, "balls", decimals=0),
    depends="at least the share of the ring's balls below",
    remedy=_CHECK_THE_RING,
    origin=f"{_BY_INSPECTION}: `python -m benchmarks.imaging.identification` has no wrong identity",
)
RING_SHARE_IDENTIFIED: Final = Criterion(
    code=ReasonCode.RING_NOT_FOUND,
    measured="share of the ring's balls whose discs fit its pattern",
    limit=at_least(0.2, "%", decimals=0),
    remedy=_CHECK_THE_RING,
    origin=RING_BALLS_IDENTIFIED.origin,
)
SECOND_IDENTITY: Final = Criterion(
    code=ReasonCode.RING_AMBIGUOUS,
    measured="balls that the second-best identity explains, as a share of those of the best one",
    limit=at_most(0.6, "%", decimals=0),
    remedy="check that the ring's file fits this ring, uncover more of it and take another image",
    origin=f"{_BY_INSPECTION}; in `python -m benchmarks.imaging.identification` the largest share is 21 %",
)
BALLS_MEASURED: Final = Criterion(
    code=ReasonCode.RING_TOO_FEW_BALLS,
    measured="share of the ring's balls that could be measured",
    limit=at_least(0.4, "%", decimals=0),
    remedy="open the collimator or uncover the ring and take another image",
    origin=_BY_INSPECTION,
)
SMEAR: Final = Criterion(
    code=ReasonCode.MOTION_BLUR,
    measured="length over which the balls' shadows are smeared",
    limit=at_most(4, "px", decimals=1),
    remedy="hold leg and C-arm still and take another image; if nothing moved, take it without edge enhancement, and "
    "from the archive rather than by a video cable",
    origin=_BY_INSPECTION,
)
CENTRAL_DEVIATION: Final = Criterion(
    code=ReasonCode.CALIBRATION_EXTRAPOLATED,
    measured="standard deviation of the distortion around the image's middle",
    limit=at_most(0.5, "px", decimals=2),
    remedy=_UNCOVER_THE_MIDDLE,
    origin=_BY_INSPECTION,
)
SOURCE_DEVIATION: Final = Criterion(
    code=ReasonCode.CALIBRATION_EXTRAPOLATED,
    measured="largest standard deviation of the focal spot",
    limit=at_most(5, "mm", decimals=1),
    remedy=_UNCOVER_THE_MIDDLE,
    origin=_BY_INSPECTION,
)
