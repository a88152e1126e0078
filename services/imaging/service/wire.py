"""What imaging says on the bus: pixels, and what came out of a calibration."""

import numpy as np

from services.imaging.devices.received_image import ReceivedImage
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.parts import RingPart
from shared.messages.base import ReasonMessage
from shared.messages.imaging import CalibrationMessage, CalibrationValues, FrameHeader
from shared.runtime.lifecycle import software_version

Outcome = Accepted[CArmCalibration] | Rejected


def wire_pixels(image: ReceivedImage) -> bytes:
    """Grey values as they travel: float32, row by row."""
    return np.ascontiguousarray(image.pixels, dtype="<f4").tobytes()


def calibration_message(outcome: Outcome, elapsed_ms: float, ring: RingPart, header: FrameHeader) -> CalibrationMessage:
    """An outcome with what it was made from."""
    accepted = isinstance(outcome, Accepted)
    return CalibrationMessage(
        image=header.reference(),
        case_id=header.case_id,
        case_revision=header.case_revision,
        ring_sha256=ring.sha256,
        software_version=software_version(),
        verdict="accepted" if accepted else "rejected",
        reasons=() if isinstance(outcome, Accepted) else tuple(ReasonMessage.of(r) for r in outcome.reasons),
        values=CalibrationValues.of(outcome.value) if isinstance(outcome, Accepted) else None,
        elapsed_ms=elapsed_ms,
    )
