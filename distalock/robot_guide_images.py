"""What one X-ray image says of the guide on the robot's head, for `distalock robot calibrate-guide`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distalock.guide_calibration.observations import GuideObservation
from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from services.registration.core.guide.locate import locate_guide
from services.registration.core.localise import unmirrored
from services.registration.core.tuning import GUIDE_MEASUREMENT
from shared.errors import Rejected
from shared.geometry.hexapod import PlatformPose
from shared.geometry.parts import GuidePart, RingPart


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """An image that can be used, or a sentence that says why not."""

    observation: GuideObservation | None
    why_not: str = ""


def observe_guide(
    pixels: NDArray[np.float32], ring: RingPart, guide: GuidePart, nominal: NominalGeometry, pose: PlatformPose
) -> Seen:
    """The guide in the ring's frame, from one image.

    Parameters
    ----------
    pixels
        The image as received, darker is denser, shape (rows, columns).
    pose
        Where the controller said that the platform stood.
    """
    calibrated = calibrate_image(pixels, ring, nominal)
    if isinstance(calibrated, Rejected):
        return Seen(None, calibrated.reasons[0].message)
    calibration = calibrated.value
    found = locate_guide(unmirrored(pixels, calibration), calibration, ring, guide)
    if isinstance(found, Rejected):
        return Seen(None, found.reasons[0].message)
    fit = found.value
    if fit.reprojection_rms_px > GUIDE_MEASUREMENT.calibration_rms_px:
        return Seen(
            None,
            f"the guide's balls are {fit.reprojection_rms_px:.2f} px from where its file puts them "
            f"(limit {GUIDE_MEASUREMENT.calibration_rms_px:g}); the block is bent or is another guide: replace it or "
            "measure it anew",
        )
    ring_from_camera = calibration.camera_from_ring.inverse()
    return Seen(
        GuideObservation(
            pose,
            ring_from_camera @ fit.camera_from_guide,
            fit.pose.covariance,
            ring_from_camera.translation_mm,
            calibration.source_covariance_mm2,
        )
    )
