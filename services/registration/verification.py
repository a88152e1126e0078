"""Wires and guide holes against the nail's hole axes, from one localised image or a pair, as a message."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.localise import LocalisationResult, Parts, unmirrored
from services.registration.core.wires import AxisComparison, verify_wires
from services.registration.core.wires_view import WireView
from services.registration.report import standard_uncertainty
from shared.geometry.calibration import CArmCalibration
from shared.messages.base import ReasonMessage
from shared.messages.registration import Localisation, Verification, VerifiedGuideHole, VerifiedWire


@dataclass(frozen=True, slots=True, eq=False)
class VerifiedImage:
    """One image with what was found in it; calibration and result are None when the ring was not found.

    Attributes
    ----------
    pixels
        The image as received, darker is denser, shape (rows, columns).
    """

    pixels: NDArray[np.float32]
    calibration: CArmCalibration | None
    result: LocalisationResult | None
    localisation: Localisation


def verification_message(
    images: tuple[VerifiedImage, ...], parts: Parts, earlier: LocalisationResult | None
) -> Verification:
    """Compare the wires in one image or two of the same set-up with the nail's hole axes.

    An image in which the guide was not found is left out; its reasons are told when the others do not suffice.

    Parameters
    ----------
    earlier
        An accepted localisation with the guide in the same place, from before the wires were inserted. Wires cover the
        holes: where the images themselves do not show the axes, these are taken.
    """
    hashes = tuple(image.localisation.image.sha256 for image in images)
    reasons_of_images = tuple(reason for image in images for reason in image.localisation.reasons)
    result = _axes(images, earlier)
    if result is None or result.guide_from_nail is None or result.holes is None:
        return Verification(verdict="rejected", reasons=reasons_of_images, images=hashes, wires=())
    views = tuple(view for image in images if (view := _view(image)) is not None)
    if not views:
        return Verification(verdict="rejected", reasons=reasons_of_images, images=hashes, wires=())
    verified = verify_wires(views, parts.guide, parts.nail, result.guide_from_nail, result.holes)
    reasons = tuple(ReasonMessage.of(reason) for reason in verified.reasons)
    if reasons and len(views) < len(images):
        reasons += reasons_of_images
    return Verification(
        verdict="rejected" if reasons else "accepted",
        reasons=reasons,
        images=hashes,
        wires=tuple(_wire(comparison) for comparison in verified.wires),
        guide_holes=tuple(_guide_hole(comparison) for comparison in verified.guide_holes),
    )


def _axes(images: tuple[VerifiedImage, ...], earlier: LocalisationResult | None) -> LocalisationResult | None:
    """The first accepted localisation of the images, else the earlier one."""
    accepted = (image.result for image in images if image.result is not None and image.result.accepted)
    return next(accepted, earlier)


def _view(image: VerifiedImage) -> WireView | None:
    if image.calibration is None or image.result is None or image.result.guide is None:
        return None
    guide = image.result.guide
    upright = unmirrored(image.pixels, image.calibration)
    return WireView(upright, image.calibration, guide.camera_from_guide, guide.covariance)


def _wire(comparison: AxisComparison) -> VerifiedWire:
    return VerifiedWire(
        id=comparison.hole_id,
        entry_offset_mm=comparison.offset.entry_mm,
        exit_offset_mm=comparison.offset.exit_mm,
        angle_deg=comparison.angle_deg,
        standard_uncertainty=standard_uncertainty(comparison.offset),
        chance_to_pass=comparison.chance_to_pass,
    )


def _guide_hole(comparison: AxisComparison) -> VerifiedGuideHole:
    return VerifiedGuideHole(
        id=comparison.hole_id,
        entry_offset_mm=comparison.offset.entry_mm,
        exit_offset_mm=comparison.offset.exit_mm,
        angle_deg=comparison.angle_deg,
        standard_uncertainty=standard_uncertainty(comparison.offset),
        chance_to_pass=comparison.chance_to_pass,
    )
