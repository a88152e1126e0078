"""What was found in one image, as its record: hole axes, pictures, and how well the C-arm looks along the holes."""

import base64
from collections.abc import Callable

from services.registration.core.fusion import ImageResult
from services.registration.core.mounting_site import site_of_nail
from services.registration.drawing import image_drawing
from services.registration.frames import LocalisedFrame, OpenCase, ReceivedFrame, calibration_of, pose_at_rest
from services.registration.guidance_report import view_of_nail
from services.registration.overlay import overlay_png
from services.registration.report import mounting_site_message, timed_localisation
from shared.errors import Accepted
from shared.messages.imaging import CalibrationMessage
from shared.messages.registration import LocalisationRecord
from shared.runtime.lifecycle import software_version


def localised_frame(
    frame: ReceivedFrame, job: CalibrationMessage, case: OpenCase, clock_s: Callable[[], float]
) -> LocalisedFrame:
    """Localise in a frame by its calibration, and make the record of it, with the image's age by then."""
    calibrated = calibration_of(job)
    result, found = timed_localisation(frame.pixels, calibrated, case.parts, job.image.sha256, job.elapsed_ms)
    calibration = calibrated.value if isinstance(calibrated, Accepted) else None
    # with the guide in view the robot is mounted already
    site = None if result.guide is not None else site_of_nail(result, calibration, case.parts, case.hexapod)
    drawing = None if calibration is None else image_drawing(job.image.sha256, calibration, result, case.parts, site)
    assessment, off_centre = view_of_nail(result, calibration, case.parts)
    pose = pose_at_rest(frame.robot)
    record = LocalisationRecord(
        localisation=found.model_copy(update={"notes": frame.header.notes}),
        image=job.image,
        case_id=case.context.case_id or "",
        case_revision=case.context.revision,
        registration_epoch=frame.epoch,
        robot_boot_epoch=frame.robot.boot_epoch if frame.robot is not None and pose is not None else None,
        robot_pose=pose,
        ring_sha256=case.parts.ring.sha256,
        guide_sha256=case.parts.guide.sha256,
        nail_sha256=case.parts.nail.sha256,
        software_version=software_version(),
        overlay_png_base64=base64.b64encode(overlay_png(frame.pixels, calibration, result, case.parts, site)).decode(),
        image_age_s=frame.age_s(clock_s()),
        mounting_site=None if site is None else mounting_site_message(site),
        drawing=drawing,
        assessment=assessment,
        off_centre_mm=off_centre,
    )
    return LocalisedFrame(frame, case, record, ImageResult(job.image.sha256[:12], frame.pixels, calibration, result))
