"""Verify K-wires: their axes, estimated from one image or a pair, against the axes of the nail's holes.

Images that show the nail's holes are fused, with earlier ones from before the wires if there are any. In the others the
guide is located, if necessary with the help of the first, and the nail's outline ties guide and nail together: all
poses are in the guide's frame (`JointRegistration`). A lateral image shows the nail's holes, and the wires nearly end
on, as stubs in the holes' openings. An oblique image shows the wires as bands: each determines a plane through a wire,
and the lateral image what the plane leaves open.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import (
    GUIDE_AXIS_BOUND,
    GUIDE_ENTRY_BOUND,
    NO_SHARED_HOLE,
    WIRE_AXIS_BOUND,
    WIRE_ENTRY_BOUND,
)
from services.registration.core.drill_clearance import AxisOffset, across_basis, axis_offset_mm
from services.registration.core.estimation.joint import fuse
from services.registration.core.fusion import ImageResult, disagreement, usable_estimate
from services.registration.core.hole_axes import HoleEstimate, holes_at, offsets_by_motion
from services.registration.core.localise import Parts, unmirrored
from services.registration.core.tuning import WIRE_VISIBILITY
from services.registration.core.wires.fit import WireFit, detect_wire
from services.registration.core.wires.image import RegisteredImage, gradient_image
from services.registration.core.wires.joint_estimate import JointRegistration, joint_registration, update_with_outline
from services.registration.core.wires.nail_fit import no_holes_reasons, relocalise_with_wires
from services.registration.core.wires.nail_outline import locate_guide_given_nail
from shared.errors import Reason, Rejected
from shared.geometry.frames import Guide, Nail
from shared.geometry.lines import Line, unit
from shared.geometry.parts import Hole
from shared.geometry.transform import Transform

Images = tuple[ImageResult, ...]

# Step of a one-sided difference: well above rounding, and small beside the distances over which offsets bend.
_DERIVATIVE_STEP_MM = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class AxisComparison:
    """An axis (of a wire, or of a guide hole) against the axis of the nail hole of the same id."""

    hole: HoleEstimate  # the nail's hole, as estimated from all images together, the wires included
    axis_guide: Line  # the axis that is compared, in the guide's frame
    # Where the axis passes the nail hole's entry and exit, across the nail hole's axis, with the covariance
    offset: AxisOffset

    @property
    def angle_deg(self) -> float:
        """Angle between both axes."""
        slope = (self.offset.mean_mm[2:] - self.offset.mean_mm[:2]) / self.offset.length_mm
        return float(np.degrees(np.arctan(np.linalg.norm(slope))))

    @property
    def chance_as_it_stands(self) -> float:
        """Probability that a drill along this axis, wherever it points, passes the nail's hole."""
        return self.hole.clearance_probability(self.offset)


@dataclass(frozen=True, slots=True, eq=False)
class WireVerification:
    """Wires and guide holes against the nail's holes."""

    # Why the measurement is rejected; none when it is accepted. Whether a drill would pass is another question:
    # `chance_as_it_stands` answers it.
    reasons: tuple[Reason, ...]
    # Those that were detected, in the order of the nail's holes, also when there are reasons
    wires: tuple[AxisComparison, ...]
    guide_holes: tuple[AxisComparison, ...]  # the guide's own holes: what a drill will follow
    # names of the images in which the wires were searched for; in others, ring or guide was not found
    images_used: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class JointResult:
    """Joint estimate from all images of one position of the guide."""

    # None when no image shows the nail's holes, or none the guide, or the images contradict one another
    estimate: JointRegistration | None
    reasons: tuple[Reason, ...]  # why there is no estimate, or why some image is not in it
    used: tuple[str, ...]  # names of the images that are in it


def verify_images(images: Images, earlier: Images, parts: Parts, wire_diameter_mm: float) -> WireVerification:
    """Verify the wires in one image or more; an unused image gives its reasons when the others do not suffice.

    Earlier images are of the same position of the guide, from before the wires, in the order in which they were taken.
    """
    relocalised = tuple(relocalise_with_wires(image, parts, wire_diameter_mm) for image in images)
    return verify_relocalised(relocalised, earlier, parts, wire_diameter_mm)


def verify_guide_alone(images: Images, earlier: Images, parts: Parts) -> WireVerification:
    """Verify the guide's own holes, without wires, in images as they were localised."""
    return verify_relocalised(images, earlier, parts, None)


def verify_guide_holes(estimate: JointRegistration, parts: Parts) -> WireVerification:
    """Compare the guide's own holes with the nail's, as all images together show them."""
    compared = tuple(_compare_guide_hole(one) for one in _shared_holes(estimate, parts))
    if not compared:
        return WireVerification((NO_SHARED_HOLE.reason(),), (), ())
    return WireVerification(tuple(reason for one in compared for reason in _guide_too_uncertain(one)), (), compared)


def verify_relocalised(
    images: Images, earlier: Images, parts: Parts, wire_diameter_mm: float | None
) -> WireVerification:
    """The same for images localised with the wires modelled; without a diameter no wires are sought."""
    joint = estimate_jointly(images, earlier, parts)
    if joint.estimate is None:
        return WireVerification(joint.reasons, (), ())
    if wire_diameter_mm is None:
        verified = verify_guide_holes(joint.estimate, parts)
    else:
        verified = verify_wires(joint.estimate, parts, wire_diameter_mm)
    reasons = verified.reasons
    if reasons and len(joint.used) < len(images):
        reasons += joint.reasons
    return replace(verified, reasons=reasons, images_used=joint.used)


def estimate_jointly(images: Images, earlier: Images, parts: Parts) -> JointResult:
    """Estimate the poses of guide and nail from images with wires, and earlier ones without."""
    all_images = (*earlier, *images)
    evidence = {id(one): found for one in all_images if (found := usable_estimate(one, parts)) is not None}
    used = tuple(one for one in all_images if id(one) in evidence)
    if not used:
        return JointResult(None, no_holes_reasons(images, parts), ())
    poses = tuple(evidence[id(one)] for one in used)
    fused = fuse(poses)
    newest = used[-1].result.nail
    assert newest is not None  # `usable_estimate` needs one
    contradiction = disagreement(fused, poses, tuple(one.name for one in used), parts, newest.camera_from_nail)
    if contradiction is not None:
        return JointResult(None, (contradiction,), ())
    registered, reasons = _registered_images(images, parts, fused.pose.mean)
    if not registered:
        return JointResult(None, reasons, ())
    source = tuple(used.index(image) if id(image) in evidence else None for image, _ in registered)
    estimate = joint_registration(tuple(one for _, one in registered), fused, source)
    # No image may have shown the holes since the wires went in: then only the outline shows whether the guide slipped.
    for k, (image, _) in enumerate(registered):
        if source[k] is None:
            estimate, innovation = update_with_outline(estimate, k, parts.guide, parts.nail)
            slipped = innovation.reason(image.name)
            if slipped is not None:
                return JointResult(None, (slipped,), ())
    return JointResult(estimate, reasons, tuple(image.name for image, _ in registered))


def _registered_images(
    images: Images, parts: Parts, guide_from_nail: Transform[Guide, Nail]
) -> tuple[tuple[tuple[ImageResult, RegisteredImage], ...], tuple[Reason, ...]]:
    """The images with their guide, and why it was not found in the others.

    As localised there, else with the help of the nail's pose from the other images.
    """
    found: list[tuple[ImageResult, RegisteredImage]] = []
    reasons: list[Reason] = []
    for image in images:
        calibration, guide = image.calibration, image.result.guide
        if calibration is None:
            reasons.extend(image.result.reasons)
            continue
        upright = unmirrored(image.pixels, calibration)
        if guide is None:
            located = locate_guide_given_nail(upright, calibration, parts, guide_from_nail)
            if isinstance(located, Rejected):
                reasons.extend(located.reasons)
                continue
            guide = located.value
        registered = RegisteredImage(upright, calibration, guide.camera_from_guide, guide.pose.covariance)
        found.append((image, registered))
    return tuple(found), tuple(reasons)


def verify_wires(estimate: JointRegistration, parts: Parts, wire_diameter_mm: float) -> WireVerification:
    """Fit the wires in one image or more and compare them with the nail's holes."""
    guide, nail = parts.guide, parts.nail.bent(estimate.curvature_per_m)
    shared = _shared_holes(estimate, parts)
    if not shared:
        return WireVerification((NO_SHARED_HOLE.reason(),), (), ())
    margin_mm = WIRE_VISIBILITY.margin_detector_mm
    gradients = tuple(
        gradient_image(image, guide, nail, estimate.guide_from_nail, margin_mm) for image in estimate.images
    )
    reasons: list[Reason] = []
    wires: list[AxisComparison] = []
    for one in shared:
        fit = detect_wire(
            gradients, guide, one.in_guide, nail, estimate.guide_from_nail, estimate.covariance, wire_diameter_mm
        )
        if isinstance(fit, Reason):
            reasons.append(fit)
            continue
        wires.append(compare_wire(fit, one.hole, one.by_nail[:, :6], one.by_curvature_mm2))
        reasons.extend(_too_uncertain(wires[-1], len(gradients)))
    return WireVerification(tuple(reasons), tuple(wires), tuple(_compare_guide_hole(one) for one in shared))


@dataclass(frozen=True, slots=True, eq=False)
class _SharedHole:
    """A hole of the nail that the guide has too, and how its offsets depend on the nail's pose and curvature."""

    hole: HoleEstimate
    in_guide: Hole
    by_nail: NDArray[np.float64]  # shape (4, 8)
    by_curvature_mm2: NDArray[np.float64]  # shape (4, 4)


def _shared_holes(estimate: JointRegistration, parts: Parts) -> tuple[_SharedHole, ...]:
    nail = parts.nail.bent(estimate.curvature_per_m)
    of_pose = np.pad(estimate.covariance[-6:, -6:], (0, 2))
    found = holes_at(nail, parts.drill_diameter_mm, estimate.guide_from_nail, of_pose, estimate.camera_from_nail(0))
    in_guide = {hole.id: hole for hole in parts.guide.holes}
    shared = []
    for hole in found:
        if hole.id in in_guide:
            by_nail = offsets_by_motion(nail, hole.id, estimate.guide_from_nail)
            by_curvature_mm2 = _by_curvature_mm2(by_nail, estimate.covariance_with_bend)
            shared.append(_SharedHole(hole, in_guide[hole.id], by_nail, by_curvature_mm2))
    return tuple(shared)


def _by_curvature_mm2(J: NDArray[np.float64], covariance: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """By how much the nail's curvature adds to the covariance of a hole's offsets, shape (4, 4): never less than 0.

    From the offsets' derivative by pose and curvature, shape (4, 8), and the covariance of both.
    """
    if covariance is None:
        return np.zeros((4, 4))
    values, vectors = np.linalg.eigh(J @ covariance @ J.T - J[:, :6] @ covariance[:6, :6] @ J[:, :6].T)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def compare_wire(
    fit: WireFit, hole: HoleEstimate, by_nail_motion: NDArray[np.float64], by_curvature_mm2: NDArray[np.float64]
) -> AxisComparison:
    """A fitted wire against a nail hole, with the uncertainties of both.

    Parameters
    ----------
    by_nail_motion
        Derivative of the hole's offsets at entry and exit by the nail's motion, shape (4, 6).
    by_curvature_mm2
        Covariance of these offsets by the nail's curvature, shape (4, 4).
    """

    def offset_mm(offsets_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        return axis_offset_mm(
            hole.axis_guide, fit.model.line_guide(offsets_mm), hole.entry_guide_mm, hole.exit_guide_mm
        )

    here = offset_mm(fit.offsets_mm)
    steps = np.eye(4) * _DERIVATIVE_STEP_MM
    by_wire = np.stack([(offset_mm(fit.offsets_mm + step) - here) / _DERIVATIVE_STEP_MM for step in steps], axis=-1)
    J = np.hstack([by_wire, -by_nail_motion])
    length_mm = float(np.linalg.norm(hole.exit_guide_mm - hole.entry_guide_mm))
    nail_moved_mm = by_nail_motion @ fit.nail_motion
    offset = AxisOffset(here - nail_moved_mm, J @ fit.covariance @ J.T + by_curvature_mm2, length_mm)
    return AxisComparison(_moved_hole(hole, nail_moved_mm), fit.model.line_guide(fit.offsets_mm), offset)


def _moved_hole(hole: HoleEstimate, across_mm: NDArray[np.float64]) -> HoleEstimate:
    """The hole after its axis has moved across itself at entry and exit, shape (4,)."""
    across = across_basis(hole.axis_guide.direction)
    entry_mm, exit_mm = hole.entry_guide_mm + across_mm[:2] @ across, hole.exit_guide_mm + across_mm[2:] @ across
    return replace(
        hole, axis_guide=Line(entry_mm, unit(exit_mm - entry_mm)), entry_guide_mm=entry_mm, exit_guide_mm=exit_mm
    )


def _compare_guide_hole(shared: _SharedHole) -> AxisComparison:
    hole, axis_guide = shared.hole, shared.in_guide.axis
    assert hole.offset is not None  # `_shared_holes` gives the holes a covariance
    mean_mm = axis_offset_mm(hole.axis_guide, axis_guide, hole.entry_guide_mm, hole.exit_guide_mm)
    covariance = hole.offset.covariance_mm2 + shared.by_curvature_mm2
    return AxisComparison(hole, axis_guide, AxisOffset(mean_mm, covariance, hole.offset.length_mm))


def _guide_too_uncertain(comparison: AxisComparison) -> list[Reason]:
    bound_mm, bound_deg = comparison.offset.entry_bound_mm, comparison.offset.axis_bound_deg
    if GUIDE_ENTRY_BOUND.is_met(bound_mm) and GUIDE_AXIS_BOUND.is_met(bound_deg):
        return []
    known = f"{GUIDE_ENTRY_BOUND.quoted(bound_mm)} and {GUIDE_AXIS_BOUND.quoted(bound_deg)} with 95 % confidence"
    return [GUIDE_ENTRY_BOUND.reason(f"guide hole '{comparison.hole.id}' is known to {known}")]


def _too_uncertain(comparison: AxisComparison, image_count: int) -> list[Reason]:
    bound_mm, bound_deg = comparison.offset.entry_bound_mm, comparison.offset.axis_bound_deg
    if WIRE_ENTRY_BOUND.is_met(bound_mm) and WIRE_AXIS_BOUND.is_met(bound_deg):
        return []
    remedy = (
        "add an image from another direction"
        if image_count == 1
        else "take both again with more dose, and the lateral one so that the wire shows in the nail's hole"
    )
    known = f"{WIRE_ENTRY_BOUND.quoted(bound_mm)} and {WIRE_AXIS_BOUND.quoted(bound_deg)} with 95 % confidence"
    return [WIRE_ENTRY_BOUND.reason(f"wire '{comparison.hole.id}' is known to {known}", remedy)]
