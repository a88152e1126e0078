"""Wires and guide holes against the nail's hole axes, from one localised image or a pair, as a message."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.fusion import LocalisedImage
from services.registration.core.localise import LocalisationResult, Parts
from services.registration.core.wires.nail_fit import ImageWithWires
from services.registration.core.wires.verify import AxisComparison, WireVerification, verify_images
from services.registration.report import standard_uncertainty
from shared.equipment import USUAL_WIRE_DIAMETER_MM
from shared.errors import Reason
from shared.geometry.calibration import CArmCalibration
from shared.messages.base import ReasonMessage
from shared.messages.registration import Localisation, Verification, VerifiedGuideHole, VerifiedWire


@dataclass(frozen=True, slots=True, eq=False)
class VerifiedImage:
    """One image with what was found in it; calibration and result are None when the ring was not found.

    Attributes
    ----------
    name
        What it is called in sentences for people.
    pixels
        The image as received, darker is denser, shape (rows, columns).
    """

    name: str
    pixels: NDArray[np.float32]
    calibration: CArmCalibration | None
    result: LocalisationResult | None
    localisation: Localisation

    def localised(self) -> LocalisedImage:
        """As the core takes it."""
        reasons = tuple(Reason(reason.code, reason.message) for reason in self.localisation.reasons)
        return LocalisedImage(self.name, self.calibration, self.result, reasons)


def verified_images(
    images: tuple[VerifiedImage, ...],
    parts: Parts,
    earlier: tuple[VerifiedImage, ...] = (),
    wire_diameter_mm: float = USUAL_WIRE_DIAMETER_MM,
) -> WireVerification:
    """Compare the wires in one image or two of the same set-up with the nail's hole axes.

    An image in which the guide was not found is left out; its reasons are reported when the others do not suffice.

    Parameters
    ----------
    earlier
        Images with the guide in the same place, from before the wires were inserted: wires cover the holes.
    """
    wired = tuple(ImageWithWires(image.pixels, image.localised()) for image in images)
    return verify_images(wired, tuple(image.localised() for image in earlier), parts, wire_diameter_mm)


def verification_message(images: tuple[VerifiedImage, ...], verified: WireVerification) -> Verification:
    """What was found in some images, as a message."""
    return Verification(
        verdict="rejected" if verified.reasons else "accepted",
        reasons=tuple(ReasonMessage.of(reason) for reason in verified.reasons),
        images=tuple(image.localisation.image.sha256 for image in images),
        wires=tuple(_wire(comparison) for comparison in verified.wires),
        guide_holes=tuple(_guide_hole(comparison) for comparison in verified.guide_holes),
    )


def _wire(comparison: AxisComparison) -> VerifiedWire:
    return VerifiedWire(
        id=comparison.hole_id,
        entry_offset_mm=comparison.offset.entry_mm,
        exit_offset_mm=comparison.offset.exit_mm,
        angle_deg=comparison.angle_deg,
        standard_uncertainty=standard_uncertainty(comparison.offset),
        chance_to_pass=comparison.chance_as_it_stands,
    )


def _guide_hole(comparison: AxisComparison) -> VerifiedGuideHole:
    return VerifiedGuideHole(
        id=comparison.hole_id,
        entry_offset_mm=comparison.offset.entry_mm,
        exit_offset_mm=comparison.offset.exit_mm,
        angle_deg=comparison.angle_deg,
        standard_uncertainty=standard_uncertainty(comparison.offset),
        chance_to_pass=comparison.chance_as_it_stands,
    )
