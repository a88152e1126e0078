"""How well the C-arm looks along the holes, as messages: of a localised image and of a followed frame."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.alignment import assess, off_centre_mm
from services.registration.core.c_arm_advice import HoleTilt, hole_tilts, middle_between_holes_mm
from services.registration.core.localise import LocalisationResult, Parts
from shared.geometry.calibration import CArmCalibration
from shared.messages.registration import OffCentre, ViewAssessment


def assessment_message(tilts: tuple[HoleTilt, ...]) -> ViewAssessment:
    """How well the C-arm looks along the holes, as a message."""
    found = assess(tilts)
    return ViewAssessment(
        quality=found.quality.value,
        largest_tilt_deg=found.largest_tilt_deg,
        saved_by_a_degree=found.saved_by_a_degree,
    )


def off_centre_message(off_centre: NDArray[np.float64]) -> OffCentre:
    """How far the holes lie off the picture's middle, as a message."""
    return OffCentre(to_image_right=float(off_centre[0]), to_image_down=float(off_centre[1]))


def view_of_nail(
    result: LocalisationResult, calibration: CArmCalibration | None, parts: Parts
) -> tuple[ViewAssessment | None, OffCentre | None]:
    """How well the C-arm looks along the holes and how far they are off the middle; None where no nail was found."""
    if calibration is None or result.nail is None:
        return None, None
    camera_from_nail, nail = result.nail.camera_from_nail, parts.with_nail_as_found(result.nail).nail
    middle_mm = middle_between_holes_mm(camera_from_nail, nail)
    return (
        assessment_message(hole_tilts(camera_from_nail, nail)),
        off_centre_message(off_centre_mm(calibration, middle_mm)),
    )
