"""Whether the C-arm looks along the holes well enough, what a degree less would buy, and where the holes lie. Pure."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import TILT
from services.registration.core.c_arm_advice import CArmAngles, HoleTilt
from services.registration.core.tuning import ALIGNMENT
from shared.geometry.calibration import CArmCalibration


class ViewQuality(StrEnum):
    """How well a view suits a localisation."""

    GOOD = "good"  # turning the C-arm further is not worth the dose
    USABLE = "usable"  # accepted, and better with less tilt
    TOO_FAR = "too_far"  # refused


@dataclass(frozen=True, slots=True)
class TiltAssessment:
    """How well the C-arm looks along the holes."""

    quality: ViewQuality
    largest_tilt_deg: float
    # Share of the axis's error that one degree less tilt takes away
    saved_by_a_degree: float


def assess(tilts: tuple[HoleTilt, ...]) -> TiltAssessment:
    """Assess a view by the hole that is tilted most; errors grow with the tilt as in the accuracy benchmark."""
    largest_deg = max(tilt.tilt_to_ray_deg for tilt in tilts)
    degree = min(1.0, largest_deg)
    saved = (
        degree
        * ALIGNMENT.axis_error_per_tilt
        / (ALIGNMENT.axis_error_deg + ALIGNMENT.axis_error_per_tilt * largest_deg)
    )
    return TiltAssessment(_quality(largest_deg), largest_deg, saved)


def _quality(largest_deg: float) -> ViewQuality:
    if not TILT.is_met(largest_deg):
        return ViewQuality.TOO_FAR
    return ViewQuality.GOOD if largest_deg <= ALIGNMENT.good_below_deg else ViewQuality.USABLE


def off_centre_mm(calibration: CArmCalibration, middle_camera_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far a point of the camera frame lies off the image's middle, to its right and down, shape (2,).

    Measured at the point's depth.
    """
    centre_px = np.array([0.5 * (calibration.width_px - 1), 0.5 * (calibration.height_px - 1)])
    if calibration.aperture is not None:
        centre_px = np.array(calibration.aperture.centre_px)
    ray = calibration.rays_camera(centre_px)
    return np.asarray(middle_camera_mm[:2] - ray[:2] * (middle_camera_mm[2] / ray[2]))


def shift_in_room_mm(
    off_centre: NDArray[np.float64], angles: CArmAngles, display_rotation_rad: float
) -> NDArray[np.float64]:
    """Shift of the C-arm that brings the holes into the image's middle, in the C-arm's own axes, shape (3,), in mm.

    For a patient who lies on the back: towards the head, to the patient's right, up. So DICOM's angles turn the beam:
    a positive primary angle takes the detector to the patient's left, a positive secondary one to the head.
    """
    cosine, sine = np.cos(display_rotation_rad), np.sin(display_rotation_rad)
    beam_from_camera = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(angles.room_from_beam @ beam_from_camera @ np.array([off_centre[0], off_centre[1], 0.0]))
