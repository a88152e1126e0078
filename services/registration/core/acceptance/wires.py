"""Acceptance of images with wires in front of the nail, and of the wires' axes: every limit."""

from typing import Final

from services.registration.core.acceptance.image import AXIS_BOUND, BEST_OPENING, ENTRY_BOUND, Openings
from shared.acceptance import Criterion, Finding, at_least, at_most
from shared.errors import ReasonCode

_RECORD: Final = "docs/decisions/0013-wires.md"
_INSPECTION: Final = "fitted by inspection on pairs of `distalock bench verification`"
_BEFORE_OR_TURNED: Final = "add an image from before the wires, or turn the C-arm by 5° and take one more image"

# The nail behind its wires

BEST_OPENING_BESIDE_WIRES: Final = Criterion(
    code=ReasonCode.HOLE_NOT_VISIBLE,
    measured="visible share of the disc of the hole that shows most beside its wire",
    limit=at_least(0.15, "%", decimals=0),
    remedy=BEST_OPENING.remedy,
    origin=f"fitted by inspection ({_RECORD}): the covariance accounts for what a wire hides of a hole",
)
OTHER_OPENING_BESIDE_WIRES: Final = Criterion(
    code=ReasonCode.HOLE_NOT_VISIBLE,
    measured="visible share of the disc of every other hole beside its wire",
    limit=at_least(0.1, "%", decimals=0),
    remedy=BEST_OPENING.remedy,
    origin=f"fitted by inspection ({_RECORD}): the spacing of the holes is measured and not only assumed",
)
BESIDE_WIRES: Final = Openings(BEST_OPENING_BESIDE_WIRES, OTHER_OPENING_BESIDE_WIRES)
OPENNESS_BESIDE_WIRES: Final = Criterion(
    code=ReasonCode.HOLE_NOT_VISIBLE,
    measured="contrast of the least visible hole where the guide's holes point, as a share of the nail's own",
    limit=at_least(0.1, "", decimals=2),
    remedy="turn the C-arm until the holes are open beside the wires",
    origin=_INSPECTION,
)
LAST_SHIFT: Final = Criterion(
    code=ReasonCode.NAIL_MODEL_MISMATCH,
    measured="shift of the nail across its holes by the last fit beside its wires",
    limit=at_most(0.3, "mm", decimals=1),
    remedy=_BEFORE_OR_TURNED,
    origin=_INSPECTION,
)
LAST_TURN: Final = Criterion(
    code=ReasonCode.NAIL_MODEL_MISMATCH,
    measured="rotation of the nail by the last fit beside its wires",
    limit=at_most(1.0, "°", decimals=1),
    remedy=_BEFORE_OR_TURNED,
    origin=_INSPECTION,
)
WIRES_LOST: Final = Finding(
    code=ReasonCode.WIRE_NOT_FOUND,
    observed="wires were found in front of the nail, and none of them after the nail was fitted beside them",
    remedy=_BEFORE_OR_TURNED,
)
GUIDE_TILT: Final = Criterion(
    code=ReasonCode.HOLE_NOT_VISIBLE,
    measured="tilt of the guide's holes against the ray, in the image that is nearest to looking along them",
    limit=at_most(25.0, "°", decimals=0),
    remedy="add an image along the wires, or one from before the wires",
    origin="derived: a nail is localised up to a tilt of 14°, and the guide may stand several degrees off",
)

# The guide in an oblique image

GUIDE_ON_NAIL: Final = Criterion(
    code=ReasonCode.GUIDE_NOT_FOUND,
    measured="share of the nail that lies on metal by the best position of a guide with 7 visible balls or more",
    limit=at_least(0.55, "%", decimals=0),
    remedy="move the C-arm until more of the guide is in the image, with the nail, and take the image again",
    origin=_INSPECTION,
)
GUIDE_ON_NAIL_MARGIN: Final = Criterion(
    code=ReasonCode.GUIDE_NOT_FOUND,
    measured="the same share, less that of the next position of the guide",
    limit=at_least(0.2, "%", decimals=0),
    remedy=GUIDE_ON_NAIL.remedy,
    origin=_INSPECTION,
)
OUTLINE_SHARE: Final = Criterion(
    code=ReasonCode.IMAGES_DISAGREE,
    measured="share of the nail's outline in an oblique image that is where guide and holes predict it",
    limit=at_least(0.6, "%", decimals=0),
    remedy="check that mount and guide are tight, and take all images again",
    origin=_INSPECTION,
)

# Each wire

WIRE_SEEN: Final = Criterion(
    code=ReasonCode.WIRE_NOT_FOUND,
    measured="visible length of a wire's outline",
    limit=at_least(7.0, "px", decimals=0),
    remedy="insert the wire up to the nail, or take an oblique image",
    origin=_INSPECTION,
)
WIRE_SHARE: Final = Criterion(
    code=ReasonCode.WIRE_NOT_FOUND,
    measured="share of a wire's outline that is seen where nothing hides it",
    limit=at_least(0.6, "%", decimals=0),
    remedy=WIRE_SEEN.remedy,
    origin=_INSPECTION,
)
WIRE_DARKNESS: Final = Criterion(
    code=ReasonCode.WIRE_NOT_FOUND,
    measured="darkness of a wire, as a share of the nail's",
    limit=at_least(0.5, "%", decimals=0),
    remedy=WIRE_SEEN.remedy,
    origin=_INSPECTION,
)
WIRE_ENTRY_BOUND: Final = Criterion(
    code=ReasonCode.UNCERTAINTY_TOO_LARGE,
    measured="95 % bound of a wire's offset from the hole's axis at the hole's entry",
    limit=ENTRY_BOUND.limit,
    remedy="add an image from another direction; of a pair, take both again with more dose, and the lateral one so "
    "that the wire shows in the nail's hole",
    origin="derived: as for a hole's axis",
)
WIRE_AXIS_BOUND: Final = Criterion(
    code=ReasonCode.UNCERTAINTY_TOO_LARGE,
    measured="95 % bound of a wire's angle against the hole's axis",
    limit=AXIS_BOUND.limit,
    remedy=WIRE_ENTRY_BOUND.remedy,
    origin="derived: as for a hole's axis",
)
NO_SHARED_HOLE: Final = Finding(
    code=ReasonCode.NAIL_MODEL_MISMATCH,
    observed="no hole of the guide has the id of a hole of the nail",
    remedy="check the guide and nail files",
)
