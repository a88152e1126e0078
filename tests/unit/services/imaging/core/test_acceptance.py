"""The list of imaging's criteria."""

from services.imaging.core import acceptance
from services.imaging.core.acceptance import CRITERIA
from shared.acceptance import Criterion, Finding
from shared.errors import ReasonCode


def test_every_criterion_is_listed_once() -> None:
    declared = [value for value in vars(acceptance).values() if isinstance(value, Criterion | Finding)]
    assert sorted(map(id, CRITERIA)) == sorted(map(id, declared))


def test_every_reason_of_an_image_and_its_ring_has_a_criterion() -> None:
    of_imaging = {
        ReasonCode.IMAGE_UNUSABLE,
        ReasonCode.SATURATED,
        ReasonCode.MOTION_BLUR,
        ReasonCode.RING_NOT_FOUND,
        ReasonCode.RING_AMBIGUOUS,
        ReasonCode.RING_TOO_FEW_BALLS,
        ReasonCode.CALIBRATION_EXTRAPOLATED,
    }
    assert {one.code for one in CRITERIA} == of_imaging
