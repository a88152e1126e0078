"""Wires and guide holes against the nail's hole axes, from one localised image or a pair, as a message."""

from typing import TypeVar

from services.registration.core.wires.verify import AxisComparison, WireVerification
from services.registration.report import standard_uncertainty
from shared.messages.base import ReasonMessage
from shared.messages.registration import Verification, VerifiedGuideHole, VerifiedWire

Axis = TypeVar("Axis", VerifiedWire, VerifiedGuideHole)


def verification_message(image_sha256s: tuple[str, ...], verified: WireVerification) -> Verification:
    """What was found in images of these hashes, as a message."""
    return Verification(
        verdict="rejected" if verified.reasons else "accepted",
        reasons=tuple(ReasonMessage.of(reason) for reason in verified.reasons),
        images=image_sha256s,
        wires=tuple(_compared(VerifiedWire, comparison) for comparison in verified.wires),
        guide_holes=tuple(_compared(VerifiedGuideHole, comparison) for comparison in verified.guide_holes),
    )


def _compared(kind: type[Axis], comparison: AxisComparison) -> Axis:
    return kind(
        id=comparison.hole_id,
        entry_offset_mm=comparison.offset.entry_mm,
        exit_offset_mm=comparison.offset.exit_mm,
        angle_deg=comparison.angle_deg,
        standard_uncertainty=standard_uncertainty(comparison.offset),
        chance_to_pass=comparison.chance_as_it_stands,
    )
