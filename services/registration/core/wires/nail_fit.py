"""The nail's pose in an image along the holes, with wires in front of them.

The wires are fitted first and then modelled while the nail is fitted, and both are repeated until they converge. What
is visible of the holes' rims beside the wires, and the nail's edges, mostly determine the pose as well as a clear view
does. A wire's place in the image is known to a fraction of a pixel once its outline has been fitted: its shadow is part
of the model, and its pixels, with those that its own error may darken, are masked.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from services.registration.core.acceptance.criteria import (
    BESIDE_WIRES,
    GUIDE_TILT,
    LAST_SHIFT,
    LAST_TURN,
    OPENNESS_BESIDE_WIRES,
    SEARCHED_OUTLINE,
    WIRES_LOST,
)
from services.registration.core.acceptance.image import fit_reasons
from services.registration.core.fusion import ImageResult, usable_estimate
from services.registration.core.guide.locate import GuideFit
from services.registration.core.guide_from_nail import NailEstimate
from services.registration.core.localise import Parts, conclude, unmirrored
from services.registration.core.nail.fit import measure_nail
from services.registration.core.nail.image_fit import NailFit
from services.registration.core.nail.occluders import Occluders, PlacedGuide, SteelRod
from services.registration.core.nail.region import FitInput
from services.registration.core.nail.search.band import SearchImage, prepare_search
from services.registration.core.nail.search.find import camera_from_nail_facing, dark_bands, pattern_quality
from services.registration.core.nail.search.holes import HolePattern, StraightenedBand, find_pattern
from services.registration.core.nail.search.outline import measure_opening
from services.registration.core.tuning import NAIL_WITH_WIRES, WIRE_VISIBILITY
from services.registration.core.wires.fit import WireFit, detect_wire
from services.registration.core.wires.image import RegisteredImage, discs_mask, gradient_image
from shared.errors import Accepted, Reason, Rejected
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import angle_between_rad, unit
from shared.geometry.parts import GuidePart, Hole, NailPart, mean_hole_direction
from shared.geometry.transform import Transform


def relocalise_with_wires(image: ImageResult, parts: Parts, wire_diameter_mm: float) -> ImageResult:
    """The image with its nail localised again, the wires in front of it modelled.

    An image is returned as it is if its guide was not found, if it was taken from aside, where no hole can be open, or
    if no wire is detected in front of the holes.
    """
    calibration, guide = image.calibration, image.result.guide
    if calibration is None or guide is None or not GUIDE_TILT.is_met(guide_tilt_deg(guide, parts)):
        return image
    nail = image.result.nail if usable_estimate(image, parts) is not None else None
    upright = unmirrored(image.pixels, calibration)
    registered = RegisteredImage(upright, calibration, guide.camera_from_guide, guide.pose.covariance)
    found = localise_nail_with_wires(registered, parts, nail, wire_diameter_mm)
    if found is None:
        return image
    return replace(image, result=conclude(calibration, parts, Accepted(guide), found))


def localise_nail_with_wires(
    image: RegisteredImage, parts: Parts, nail: NailEstimate | None, wire_diameter_mm: float
) -> Accepted[NailEstimate] | Rejected | None:
    """The nail and the wires in front of it; None when no wire is detected there.

    The nail is an accepted estimate that did not model wires, if there is one.
    """
    if nail is not None:
        return _alternating_fit(image, parts, nail.camera_from_nail, wire_diameter_mm, first_rough=False)
    start = locate_nail_near_guide_axes(image, parts.guide, parts.nail)
    if isinstance(start, Rejected):
        return start
    return _alternating_fit(image, parts, start.value, wire_diameter_mm, first_rough=True)


def locate_nail_near_guide_axes(
    registered: RegisteredImage, guide: GuidePart, nail: NailPart
) -> Accepted[Transform[Camera, Nail]] | Rejected:
    """Start of a fit: the nail's pose to a few pixels and degrees, with its holes along the guide's.

    A wire in an opening makes it dim, and the whole image has brighter places than that: the guide's own bores beside
    the nail. But wires go through the guide's holes towards the nail's: those cannot be far from the guide's axes.
    """
    calibration, camera_from_guide = registered.calibration, registered.camera_from_guide
    image = prepare_search(registered.pixels, calibration, nail)
    best = max(_patterns(image, registered, guide, nail), key=pattern_quality, default=None)
    openness = 0.0 if best is None else float(best.openness.min())
    if best is None or not OPENNESS_BESIDE_WIRES.is_met(openness):
        observation = (
            f"within {NAIL_WITH_WIRES.reach_from_axes_mm:.0f} mm of where the guide's holes point, the contrast of the "
            f"nail's least visible hole is {OPENNESS_BESIDE_WIRES.quoted(max(openness, 0.0))} of the nail's own"
        )
        return Rejected((OPENNESS_BESIDE_WIRES.reason(observation),))
    centres_px = [
        _centre_ideal_px(registered, image, best, place, hole)
        for place, hole in zip(best.centre_search_px, nail.holes, strict=True)
    ]
    depth_mm = calibration.camera.focal_length_px / (best.px_per_mm * image.step_px)
    rays = calibration.camera.rays(np.array(centres_px))
    drilling, distal = camera_from_guide.directions(np.stack([mean_hole_direction(guide), [1.0, 0.0, 0.0]]))
    return Accepted(camera_from_nail_facing(nail, rays, drilling, distal, depth_mm))


def _patterns(
    image: SearchImage, registered: RegisteredImage, guide: GuidePart, nail: NailPart
) -> Iterator[HolePattern]:
    """The holes along each band of the nail's width, in the guide's sense, where the guide's axes meet the band."""
    distal = registered.camera_from_guide.directions(np.array([1.0, 0.0, 0.0]))
    for strip in dark_bands(image, registered.calibration, nail):
        px_per_mm = strip.band.width_px / nail.diameter_mm
        depth_mm = registered.calibration.camera.focal_length_px / (px_per_mm * image.step_px)
        places_px = _axes_at_depth_px(registered, guide, depth_mm) / image.step_px
        valid = strip.valid & _near(strip, places_px, NAIL_WITH_WIRES.reach_from_axes_mm * px_per_mm)
        if not valid.any():
            continue
        forwards, backwards = find_pattern(replace(strip, valid=valid), nail)
        yield forwards if float(strip.band.along @ distal[:2]) >= 0.0 else backwards


def _axes_at_depth_px(registered: RegisteredImage, guide: GuidePart, depth_mm: float) -> NDArray[np.float64]:
    """Ideal pixels where the guide's axes reach a depth, shape (H, 2)."""
    points = registered.camera_from_guide.points(np.array([hole.axis.point_mm for hole in guide.holes]))
    along = registered.camera_from_guide.directions(np.array([hole.axis.direction for hole in guide.holes]))
    at_depth = points + along * ((depth_mm - points[:, 2]) / along[:, 2])[:, None]
    return np.asarray(registered.calibration.camera.project(at_depth))


def _near(strip: StraightenedBand, places_px: NDArray[np.float64], reach_px: float) -> NDArray[np.bool_]:
    """Columns of a strip within reach of one of some places of the search image; none when all lie beside the band."""
    band = strip.band
    column = (places_px - band.centre_px) @ band.along - strip.first_along_px
    aside = np.abs((places_px - band.centre_px) @ band.across)
    apart = np.abs(np.arange(strip.valid.size)[:, None] - column)
    return np.asarray(((apart < reach_px) & (aside < reach_px)).any(axis=1))


def _centre_ideal_px(
    registered: RegisteredImage,
    image: SearchImage,
    pattern: HolePattern,
    place_search_px: NDArray[np.float64],
    hole: Hole,
) -> NDArray[np.float64]:
    """Centre of an opening's outline where enough of it is visible beside the wire, else that of the pattern."""
    calibration = registered.calibration
    ideal = image.ideal_px(place_search_px)
    px_per_mm = pattern.px_per_mm * image.step_px
    radius_px = 0.5 * hole.diameter_mm * px_per_mm
    half_slot_px = hole.half_slot_mm * px_per_mm * pattern.strip.band.along
    centre_px = calibration.distortion.distort(ideal)
    opening = measure_opening(registered.pixels, calibration, hole.id, centre_px, radius_px, half_slot_px)
    if opening is None or not SEARCHED_OUTLINE.is_met(opening.seen_fraction):
        return ideal
    return opening.ellipse.centre_px


def _alternating_fit(
    image: RegisteredImage,
    parts: Parts,
    start: Transform[Camera, Nail],
    wire_diameter_mm: float,
    *,
    first_rough: bool,
) -> Accepted[NailEstimate] | Rejected | None:
    """Wires, nail, and again until they converge; None when there is no wire around a fitted nail.

    Around a start that is rough the first round looks for wires farther from metal, and may find none.
    """
    pose, found_before = start, False
    for round_index in range(NAIL_WITH_WIRES.rough_rounds if first_rough else NAIL_WITH_WIRES.fitted_rounds):
        rough = first_rough and round_index == 0
        margin_mm = NAIL_WITH_WIRES.rough_margin_detector_mm if rough else WIRE_VISIBILITY.margin_detector_mm
        wires = _wires(image, parts, image.camera_from_guide.inverse() @ pose, margin_mm, wire_diameter_mm)
        if not (wires or rough):
            return Rejected((WIRES_LOST.reason(),)) if found_before else None
        found_before = bool(wires)
        measured = _measured_nail(image, parts, pose, wires)
        if isinstance(measured, Rejected):
            return measured
        fit = measured.value
        (turn_deg, shift_mm), pose = _turn_and_shift(pose.inverse() @ fit.camera_from_nail), fit.camera_from_nail
        if wires and turn_deg < NAIL_WITH_WIRES.converged_deg and shift_mm < NAIL_WITH_WIRES.converged_mm:
            break
    if not (LAST_SHIFT.is_met(shift_mm) and LAST_TURN.is_met(turn_deg)):
        quoted = f"{LAST_SHIFT.quoted(shift_mm)} and {LAST_TURN.quoted(turn_deg)}"
        observation = f"nail and wires do not converge: the last fit moved the nail by {quoted}"
        return Rejected((LAST_SHIFT.reason(observation),))
    reasons = fit_reasons(replace(fit.evidence, openings=BESIDE_WIRES))
    return Rejected(reasons) if reasons else Accepted(NailEstimate.of_fit(fit))


def _turn_and_shift(motion: Transform[Nail, Nail]) -> tuple[float, float]:
    """In degrees, and in mm across the holes: depth is neither well determined nor of consequence here."""
    turn_rad, shift_mm = np.linalg.norm(motion.rotation_vector_rad), np.linalg.norm(motion.translation_mm[:2])
    return float(np.degrees(turn_rad)), float(shift_mm)


def _measured_nail(
    image: RegisteredImage, parts: Parts, start: Transform[Camera, Nail], wires: tuple[WireFit, ...]
) -> Accepted[NailFit] | Rejected:
    """The nail fitted with the wires in its model and their pixels masked."""
    rods = tuple(_rod(image, wire, 0.0) for wire in wires)
    longer = [_rod(image, wire, NAIL_WITH_WIRES.masked_end_sigmas) for wire in wires]
    hidden = [rod.discs_px(image.calibration, NAIL_WITH_WIRES.masked_beside_wire_mm) for rod in longer]
    masked = discs_mask(image, np.concatenate([np.zeros((0, 3)), *hidden]))
    placed = PlacedGuide(parts.guide, image.camera_from_guide)
    occluders = Occluders(placed, parts.ring, masked, rods)
    return measure_nail(FitInput(image.pixels, image.calibration, parts.nail, occluders), start)


def _wires(
    image: RegisteredImage,
    parts: Parts,
    guide_from_nail: Transform[Guide, Nail],
    margin_detector_mm: float,
    wire_diameter_mm: float,
) -> tuple[WireFit, ...]:
    """The wires that are detected in one image."""
    gradients = gradient_image(image, parts.guide, parts.nail, guide_from_nail, margin_detector_mm)
    # A wire does not correct the nail here: any covariance of the nail gives the same result.
    covariance = block_diag(image.guide_covariance, np.eye(6))
    in_nail = {hole.id for hole in parts.nail.holes}
    found = (
        detect_wire((gradients,), parts.guide, hole, parts.nail, guide_from_nail, covariance, wire_diameter_mm)
        for hole in parts.guide.holes
        if hole.id in in_nail
    )
    return tuple(one for one in found if not isinstance(one, Reason))


def _rod(image: RegisteredImage, wire: WireFit, longer_sigmas: float) -> SteelRod:
    """The wire in the camera's frame, at either end longer by so many standard deviations."""
    longer_mm = longer_sigmas * wire.ends_sd_mm * np.array([-1.0, 1.0])
    ends = wire.model.ends_guide_mm(wire.offsets_mm, wire.ends_mm + longer_mm)
    start, end = image.camera_from_guide.points(ends)
    return SteelRod(start, end, 2.0 * wire.model.radius_mm)


def no_holes_reasons(images: tuple[ImageResult, ...], parts: Parts) -> tuple[Reason, ...]:
    """Reasons when no image shows the nail's holes: those of the images along the holes, if there are any.

    An oblique image need not show them, so it gives no reason.
    """
    guides = [image.result.guide for image in images]
    tilts = [None if guide is None else guide_tilt_deg(guide, parts) for guide in guides]
    along = [image for image, tilt in zip(images, tilts, strict=True) if tilt is not None and GUIDE_TILT.is_met(tilt)]
    if along:
        reasons = (reason for image in along for reason in image.result.reasons)
        return tuple(Reason(one.code, f"{one.message}; or add an image from before the wires") for one in reasons)
    known = [tilt for tilt in tilts if tilt is not None]
    if not known:
        return tuple(reason for image in images for reason in image.result.reasons)
    return (
        GUIDE_TILT.reason(
            "no image looks along the nail's holes: the guide's are tilted against the beam by "
            f"{GUIDE_TILT.quoted(min(known))} or more"
        ),
    )


def guide_tilt_deg(guide: GuideFit, parts: Parts) -> float:
    """Angle between the mean direction of the guide's holes and the ray to about where they meet the nail."""
    drilling = mean_hole_direction(parts.guide)
    ray = unit(guide.camera_from_guide @ (NAIL_WITH_WIRES.guide_to_nail_mm * drilling))
    return float(np.degrees(angle_between_rad(guide.camera_from_guide.directions(drilling), ray)))
