"""Core values to messages: what `locate` prints and what the bus carries."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from services.registration.core.drill_clearance import AxisOffset
from services.registration.core.fusion import FusedLocalisation
from services.registration.core.guide.locate import GuideFit
from services.registration.core.guide_from_nail import NailEstimate
from services.registration.core.hole_axes import HoleEstimate
from services.registration.core.localise import LocalisationResult, LocalisationStep, Parts, localise
from services.registration.core.mounting_site import MountingScrew, MountingSite
from shared.errors import Accepted, Rejected
from shared.geometry.bend import MM_PER_M
from shared.geometry.calibration import CArmCalibration
from shared.messages.base import ReasonMessage
from shared.messages.geometry import matrix3, matrix4, pixel, vector3
from shared.messages.registration import (
    AdvisedScrew,
    CArmCorrection,
    Curvature,
    FusedImage,
    Fusion,
    Localisation,
    LocalisedCamera,
    LocalisedGuide,
    LocalisedHole,
    LocalisedImage,
    LocalisedNail,
    Method,
    MountingSiteMessage,
    StandardUncertainty,
    Timing,
    Verification,
    VerificationOf,
    VerifiedGuideHole,
    VerifiedWire,
)

if TYPE_CHECKING:  # locating one image loads no wires
    from services.registration.core.wires.verify import AxisComparison, WireVerification

Axis = TypeVar("Axis", VerifiedWire, VerifiedGuideHole)
Localiser = Callable[
    [NDArray[np.float32], CArmCalibration, Parts, Callable[[LocalisationStep], None]], LocalisationResult
]


class LocalisationOfSeveral(Localisation):
    """What `distalock locate` prints for several images: what it prints for one, and how the images agree."""

    fusion: Fusion


def message_of_several(
    fused: FusedLocalisation | None, messages: tuple[Localisation, ...], names: tuple[str, ...]
) -> LocalisationOfSeveral:
    """The joint localisation of several images, accepted or rejected; `fused` is None when none could be used."""
    agreement = fusion_message(fused, messages)
    if fused is None:
        named = zip(names, messages, strict=True)
        reasons = tuple(
            ReasonMessage(code=reason.code, message=f"image {name}: {reason.message}")
            for name, message in named
            for reason in message.reasons
        )
        return LocalisationOfSeveral(**dict(messages[-1]) | {"reasons": reasons}, fusion=agreement)
    result = fused.result
    joint = {
        "verdict": "accepted" if result.accepted else "rejected",
        "reasons": tuple(ReasonMessage.of(reason) for reason in result.reasons),
        "guide_from_nail": None if result.guide_from_nail is None else matrix4(result.guide_from_nail),
        "holes": None if result.holes is None else tuple(_hole(hole) for hole in result.holes),
        "timing_ms": Timing(total=sum(message.timing_ms.total for message in messages)),
    }
    return LocalisationOfSeveral(**dict(messages[fused.shown]) | joint, fusion=agreement)


def fusion_message(fused: FusedLocalisation | None, messages: tuple[Localisation, ...]) -> Fusion:
    """How several images agree, and which were used."""
    images = tuple(
        FusedImage(
            sha256=message.image.sha256,
            verdict=message.verdict,
            reasons=message.reasons,
            used=fused is not None and fused.shares[k].used,
            chi_square=None if fused is None else fused.shares[k].chi_square,
        )
        for k, message in enumerate(messages)
    )
    if fused is None:
        return Fusion(images=images, chi_square=0.0, chi_square_limit=0.0, degrees_of_freedom=0)
    return Fusion(
        images=images,
        chi_square=fused.chi_square,
        chi_square_limit=fused.chi_square_limit,
        degrees_of_freedom=fused.degrees_of_freedom,
    )


def localisation_message(
    result: LocalisationResult,
    calibration: CArmCalibration | None,
    image_sha256: str,
    times: Timing,
    method: Method = "model",
) -> Localisation:
    """A localisation of an image, accepted or rejected; of one that has no calibration nothing else is known."""
    correction = result.correction
    return Localisation(
        verdict="accepted" if result.accepted else "rejected",
        reasons=tuple(ReasonMessage.of(reason) for reason in result.reasons),
        method=method,
        image=LocalisedImage(sha256=image_sha256, mirrored=None if calibration is None else calibration.mirrored),
        camera=None if calibration is None else _camera(calibration),
        guide=None if result.guide is None else _guide(result.guide),
        nail=None if result.nail is None else _nail(result.nail),
        guide_from_nail=None if result.guide_from_nail is None else matrix4(result.guide_from_nail),
        holes=None if result.holes is None else tuple(_hole(hole) for hole in result.holes),
        c_arm_correction_deg=None
        if correction is None
        else CArmCorrection(about_image_x=correction.about_x_deg, about_image_y=correction.about_y_deg),
        timing_ms=times,
    )


def timed_localisation(
    pixels: NDArray[np.float32],
    calibrated: Accepted[CArmCalibration] | Rejected,
    parts: Parts,
    image_sha256: str,
    ring_ms: float,
    method: tuple[Method, Localiser] = ("model", localise),
) -> tuple[LocalisationResult, Localisation]:
    """Localise in an image as received, and its message with the time each step took.

    The calibration came before and took `ring_ms`; where it was rejected, so is the localisation. A method is its name
    in the message and the function that localises.
    """
    name, localise_by = method
    if isinstance(calibrated, Rejected):
        result = LocalisationResult(calibrated.reasons, None, None, None, None, None)
        return result, localisation_message(result, None, image_sha256, Timing(total=ring_ms, ring=ring_ms), name)
    ends: dict[LocalisationStep, float] = {}
    start = time.perf_counter()
    result = localise_by(pixels, calibrated.value, parts, lambda step: ends.update({step: time.perf_counter()}))
    guide_ms = 1e3 * (ends[LocalisationStep.GUIDE] - start)
    nail_ms = 1e3 * (ends[LocalisationStep.NAIL] - ends[LocalisationStep.GUIDE])
    times = Timing(total=ring_ms + 1e3 * (time.perf_counter() - start), ring=ring_ms, guide=guide_ms, nail=nail_ms)
    return result, localisation_message(result, calibrated.value, image_sha256, times, name)


def mounting_site_message(site: MountingSite) -> MountingSiteMessage:
    """Where the mount's screws go, as a message."""
    distal, proximal = (_advised(screw) for screw in site.screws)
    begin_px, end_px = (pixel(end) for end in site.range_px)
    return MountingSiteMessage(
        head_extension_mm=site.head_extension_mm,
        screws=(distal, proximal),
        screw_diameter_mm=site.screw_diameter_mm,
        range_px=(begin_px, end_px),
    )


def _advised(screw: MountingScrew) -> AdvisedScrew:
    outside_px, at_nail_px = (pixel(end) for end in screw.axis_px)
    return AdvisedScrew(
        id=screw.id,
        proximal_mm=screw.proximal_mm,
        outside_px=outside_px,
        at_nail_px=at_nail_px,
        tilt_to_ray_deg=screw.tilt_to_ray_deg,
        shown=screw.shown,
    )


def verification_message(
    image_sha256s: tuple[str, ...], verified: "WireVerification", of: VerificationOf = "wires"
) -> Verification:
    """What was found in images of these hashes, as a message."""
    return Verification(
        verdict="rejected" if verified.reasons else "accepted",
        reasons=tuple(ReasonMessage.of(reason) for reason in verified.reasons),
        images=image_sha256s,
        wires=tuple(_compared(VerifiedWire, comparison) for comparison in verified.wires),
        guide_holes=tuple(_compared(VerifiedGuideHole, comparison) for comparison in verified.guide_holes),
        of=of,
    )


def _compared(kind: type[Axis], comparison: "AxisComparison") -> Axis:
    return kind(
        id=comparison.hole.id,
        entry_offset_mm=comparison.offset.entry_mm,
        exit_offset_mm=comparison.offset.exit_mm,
        angle_deg=comparison.angle_deg,
        standard_uncertainty=standard_uncertainty(comparison.offset),
        chance_to_pass=comparison.chance_as_it_stands,
    )


def standard_uncertainty(offset: AxisOffset) -> StandardUncertainty:
    """Predicted rms of the two errors that count."""
    return StandardUncertainty(entry_mm=offset.entry_sd_mm, axis_deg=offset.axis_sd_deg)


def _camera(calibration: CArmCalibration) -> LocalisedCamera:
    return LocalisedCamera(
        intrinsic_matrix_px=matrix3(calibration.camera.intrinsic_matrix_px),
        camera_from_ring=matrix4(calibration.camera_from_ring),
        balls_found=calibration.balls_found,
        balls_expected=calibration.balls_expected,
        distortion_residual_px=calibration.distortion_residual_px,
        reprojection_rms_px=calibration.reprojection_rms_px,
    )


def _guide(guide: GuideFit) -> LocalisedGuide:
    return LocalisedGuide(
        camera_from_guide=matrix4(guide.camera_from_guide),
        balls_found=guide.balls_found,
        balls_expected=guide.balls_expected,
        reprojection_rms_px=guide.reprojection_rms_px,
    )


def _nail(nail: NailEstimate) -> LocalisedNail:
    return LocalisedNail(
        camera_from_nail=matrix4(nail.camera_from_nail), mirror_margin=nail.mirror_margin, curvature=_curvature(nail)
    )


def _curvature(nail: NailEstimate) -> Curvature | None:
    y, z = nail.curvature_per_m
    if nail.errors is None or (y, z) == (0.0, 0.0):
        return None
    variance = float(np.trace(nail.errors.covariance_with_bend[6:, 6:]))
    return Curvature(
        y_per_m=y, z_per_m=z, radius_mm=MM_PER_M / float(np.hypot(y, z)), standard_uncertainty_per_m=variance**0.5
    )


def _hole(hole: HoleEstimate) -> LocalisedHole:
    return LocalisedHole(
        id=hole.id,
        entry_point_guide_mm=vector3(hole.entry_guide_mm),
        axis_guide=vector3(hole.axis_guide.direction),
        tilt_to_ray_deg=hole.tilt_to_ray_deg,
        chance_to_pass=hole.chance_along_estimate,
        standard_uncertainty=None if hole.offset is None else standard_uncertainty(hole.offset),
    )
