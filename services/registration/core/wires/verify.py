"""Verify K-wires: their axes, as one image or a pair shows them, against the axes of the nail's holes.

Images of a pair are tied together by the guide, which is found in each of them, and by the nail's outline: everything
is expressed in the guide's frame (`SetUp`). The lateral image shows the nail's holes, and the wires nearly end on, as
stubs in the holes' openings. An oblique image shows the wires as bands: each gives a plane through the wire, and the
lateral image what the plane leaves open.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.wires import NO_SHARED_HOLE, WIRE_AXIS_BOUND, WIRE_ENTRY_BOUND
from services.registration.core.drill_clearance import AxisOffset, across_basis, angle_deg, axis_offset_mm
from services.registration.core.estimation.joint import fuse
from services.registration.core.fusion import Estimates, LocalisedImage, disagreement, usable_estimate
from services.registration.core.guide.locate import GuideFit
from services.registration.core.hole_axes import HoleEstimate, holes_at, offsets_by_motion
from services.registration.core.localise import LocalisationResult, Parts, unmirrored
from services.registration.core.wires.fit import WireFit, find_wire
from services.registration.core.wires.guided_search import locate_guide_beside
from services.registration.core.wires.image import WireView, prepare_view
from services.registration.core.wires.joint_estimate import SetUp, set_up_of, with_outline
from services.registration.core.wires.nail_fit import WiredImage, beside_wires, why_no_holes
from shared.errors import Accepted, Reason, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Guide, Nail
from shared.geometry.lines import Line, unit
from shared.geometry.parts import GuidePart, Hole
from shared.geometry.transform import Transform

_DIFFERENCE_MM = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class AxisComparison:
    """An axis (of a wire, or of a guide hole) against the axis of the nail hole of the same id.

    Attributes
    ----------
    hole
        The nail's hole: where all images together put it, the wires among what they show.
    axis_guide
        The axis that is compared, in the guide's frame.
    offset
        Where the axis passes the nail hole's entry and exit, across the nail hole's axis, with the covariance.
    angle_deg
        Angle between both axes.
    chance_as_it_stands
        Probability that a drill along this axis, wherever it points, passes the nail's hole.
    """

    hole: HoleEstimate
    axis_guide: Line
    offset: AxisOffset
    angle_deg: float
    chance_as_it_stands: float

    @property
    def hole_id(self) -> str:
        """Which hole of guide and nail."""
        return self.hole.id


@dataclass(frozen=True, slots=True, eq=False)
class WireVerification:
    """Wires and guide holes against the nail's holes.

    Attributes
    ----------
    reasons
        Why the measurement may not be relied on; none when it may. Whether a drill would pass is another question:
        `chance_as_it_stands` answers it.
    wires
        Those that were found, in the order of the nail's holes, also when there are reasons.
    guide_holes
        The guide's own holes: what a drill will follow.
    images_used
        Names of the images in which the wires were looked for; of others, ring or guide was not found.
    """

    reasons: tuple[Reason, ...]
    wires: tuple[AxisComparison, ...]
    guide_holes: tuple[AxisComparison, ...]
    images_used: tuple[str, ...] = ()


def verify_wires(set_up: SetUp, parts: Parts) -> WireVerification:
    """Measure the wires in one image or more and compare them with the nail's holes."""
    guide, nail = parts.guide, parts.nail
    holes = holes_at(
        nail, parts.drill_diameter_mm, set_up.guide_from_nail, set_up.nail_covariance, set_up.camera_from_nail(0)
    )
    pairs = _paired(guide, holes)
    if not pairs:
        return WireVerification((NO_SHARED_HOLE.reason(),), (), ())
    prepared = tuple(prepare_view(view, guide, nail, set_up.guide_from_nail) for view in set_up.views)
    reasons: list[Reason] = []
    wires: list[AxisComparison] = []
    for guide_hole, hole in pairs:
        fit = find_wire(prepared, guide, guide_hole, nail, set_up.guide_from_nail, set_up.covariance)
        if isinstance(fit, Reason):
            reasons.append(fit)
            continue
        wires.append(compare_wire(fit, hole, offsets_by_motion(nail, hole.id, set_up.guide_from_nail)))
        reasons.extend(_too_uncertain(wires[-1], len(prepared)))
    guide_holes = tuple(_compare_guide_hole(guide_hole.axis, hole) for guide_hole, hole in pairs)
    return WireVerification(tuple(reasons), tuple(wires), guide_holes)


def compare_wire(fit: WireFit, hole: HoleEstimate, by_nail_motion: NDArray[np.float64]) -> AxisComparison:
    """A fitted wire against a nail hole, with the uncertainties of both.

    Parameters
    ----------
    by_nail_motion
        How the hole's axis moves across itself at entry and exit with the nail, shape (4, 6).
    """

    def offset_mm(offsets_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        return axis_offset_mm(
            hole.axis_guide, fit.model.line_guide(offsets_mm), hole.entry_guide_mm, hole.exit_guide_mm
        )

    here = offset_mm(fit.offsets_mm)
    steps = np.eye(4) * _DIFFERENCE_MM
    by_wire = np.stack([(offset_mm(fit.offsets_mm + step) - here) / _DIFFERENCE_MM for step in steps], axis=-1)
    J = np.hstack([by_wire, -by_nail_motion])
    length_mm = float(np.linalg.norm(hole.exit_guide_mm - hole.entry_guide_mm))
    nail_moved_mm = by_nail_motion @ fit.nail_motion
    offset = AxisOffset(here - nail_moved_mm, J @ fit.covariance @ J.T, length_mm)
    slope = (offset.mean_mm[2:] - offset.mean_mm[:2]) / length_mm
    between_deg = float(np.degrees(np.arctan(np.linalg.norm(slope))))
    return AxisComparison(
        _moved_hole(hole, nail_moved_mm), fit.line_guide, offset, between_deg, hole.clearance_probability(offset)
    )


def _moved_hole(hole: HoleEstimate, across_mm: NDArray[np.float64]) -> HoleEstimate:
    """The hole after its axis has moved across itself at entry and exit, shape (4,)."""
    across = across_basis(hole.axis_guide.direction)
    entry_mm, exit_mm = hole.entry_guide_mm + across_mm[:2] @ across, hole.exit_guide_mm + across_mm[2:] @ across
    return replace(
        hole, axis_guide=Line(entry_mm, unit(exit_mm - entry_mm)), entry_guide_mm=entry_mm, exit_guide_mm=exit_mm
    )


def _compare_guide_hole(axis_guide: Line, hole: HoleEstimate) -> AxisComparison:
    assert hole.offset is not None  # `verify_wires` gives the holes a covariance
    mean_mm = axis_offset_mm(hole.axis_guide, axis_guide, hole.entry_guide_mm, hole.exit_guide_mm)
    offset = AxisOffset(mean_mm, hole.offset.covariance_mm2, hole.offset.length_mm)
    between_deg = angle_deg(hole.axis_guide, axis_guide)
    return AxisComparison(hole, axis_guide, offset, between_deg, hole.clearance_probability(offset))


def _paired(guide: GuidePart, holes: tuple[HoleEstimate, ...]) -> list[tuple[Hole, HoleEstimate]]:
    by_id = {hole.id: hole for hole in guide.holes}
    return [(by_id[hole.id], hole) for hole in holes if hole.id in by_id]


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
    return [WIRE_ENTRY_BOUND.reason(f"wire '{comparison.hole_id}' is known to {known}", remedy)]


@dataclass(frozen=True, slots=True, eq=False)
class SeenSetUp:
    """What the images give.

    Attributes
    ----------
    set_up
        None when no image shows the nail's holes, or none the guide, or they contradict one another.
    reasons
        Why there is no set-up, or why some image is not in it.
    used
        Names of the images that are in it.
    """

    set_up: SetUp | None
    reasons: tuple[Reason, ...]
    used: tuple[str, ...]


def verify_images(
    images: tuple[WiredImage, ...], earlier: tuple[LocalisedImage, ...], parts: Parts
) -> WireVerification:
    """Measure the wires in one image or more; an image that is left out tells why when the others do not suffice."""
    return verify_seen(tuple(beside_wires(image, parts) for image in images), earlier, parts)


def verify_seen(images: tuple[WiredImage, ...], earlier: tuple[LocalisedImage, ...], parts: Parts) -> WireVerification:
    """The same for images in which the nail has been looked for behind the wires (`beside_wires`)."""
    seen = seen_set_up(images, earlier, parts)
    if seen.set_up is None:
        return WireVerification(seen.reasons, (), ())
    verified = replace(verify_wires(seen.set_up, parts), images_used=seen.used)
    if not verified.reasons or len(seen.used) == len(images):
        return verified
    return replace(verified, reasons=verified.reasons + seen.reasons)


def seen_set_up(images: tuple[WiredImage, ...], earlier: tuple[LocalisedImage, ...], parts: Parts) -> SeenSetUp:
    """Put everything together that images with wires, and earlier ones without, say of guide and nail.

    Parameters
    ----------
    earlier
        Of the same set-up, in the order in which they were taken.
    """
    all_images = (*earlier, *(image.found for image in images))
    estimates = {id(one): estimate for one in all_images if (estimate := usable_estimate(one, parts)) is not None}
    used = tuple(one for one in all_images if id(one) in estimates)
    if not used:
        return SeenSetUp(None, why_no_holes(images, parts), ())
    found = tuple(estimates[id(one)] for one in used)
    against = _against(used, found, parts)
    if against is not None:
        return SeenSetUp(None, (against,), ())
    joint = fuse(found)
    seen, reasons = _views(images, parts, joint.pose.mean)
    if not seen:
        return SeenSetUp(None, reasons, ())
    source = tuple(used.index(one.image) if id(one.image) in estimates else None for one in seen)
    set_up = set_up_of(tuple(one.view for one in seen), joint, source)
    return _outlined(set_up, source, seen, parts, reasons)


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """An image in which the guide was found."""

    image: LocalisedImage
    view: WireView


def _views(
    images: tuple[WiredImage, ...], parts: Parts, guide_from_nail: Transform[Guide, Nail]
) -> tuple[tuple[_Seen, ...], tuple[Reason, ...]]:
    """The images in which the guide was found, and why it was not in the others."""
    seen: list[_Seen] = []
    reasons: list[Reason] = []
    for image in images:
        view = _view(image, parts, guide_from_nail)
        if isinstance(view, Rejected):
            reasons.extend(view.reasons)
        else:
            seen.append(_Seen(image.found, view))
    return tuple(seen), tuple(reasons)


def _outlined(
    set_up: SetUp, source: tuple[int | None, ...], seen: tuple[_Seen, ...], parts: Parts, reasons: tuple[Reason, ...]
) -> SeenSetUp:
    """The set-up corrected by the nail's outline in the images that do not show its holes, if that is where it must be.

    No image may have shown the holes since the wires went in: only the outline tells then whether the guide slipped.
    """
    for k, one in enumerate(seen):
        if source[k] is None:
            outlined = with_outline(set_up, k, parts.guide, parts.nail)
            against = outlined.departure.reason(one.image.name)
            if against is not None:
                return SeenSetUp(None, (against,), ())
            set_up = outlined.set_up
    return SeenSetUp(set_up, reasons, tuple(one.image.name for one in seen))


def _against(used: tuple[LocalisedImage, ...], estimates: Estimates, parts: Parts) -> Reason | None:
    newest = used[-1].result
    assert newest is not None  # `usable_estimate` needs one
    assert newest.nail is not None
    return disagreement(estimates, tuple(one.name for one in used), parts, newest.nail.camera_from_nail)


def _view(image: WiredImage, parts: Parts, guide_from_nail: Transform[Guide, Nail]) -> WireView | Rejected:
    """The guide in one image: as it was found there, else with the help of what the others say of the nail."""
    calibration, result = image.found.calibration, image.found.result
    if calibration is None:
        return Rejected(image.found.reasons)
    upright = unmirrored(image.pixels, calibration)
    guide = _guide(upright, calibration, result, parts, guide_from_nail)
    if isinstance(guide, Rejected):
        return guide
    return WireView(upright, calibration, guide.value.camera_from_guide, guide.value.pose.covariance)


def _guide(
    upright: NDArray[np.float32],
    calibration: CArmCalibration,
    result: LocalisationResult | None,
    parts: Parts,
    guide_from_nail: Transform[Guide, Nail],
) -> Accepted[GuideFit] | Rejected:
    if result is not None and result.guide is not None:
        return Accepted(result.guide)
    return locate_guide_beside(upright, calibration, parts, guide_from_nail)
