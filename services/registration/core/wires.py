"""Verify K-wires: their axes, as one image or a pair shows them, against the axes of the nail's holes.

Images of a pair are tied together by the guide, which is found in each of them: everything is expressed in its frame.
The lateral image shows the nail's holes, and the wires nearly end on, as stubs in the holes' openings. An oblique image
shows the wires as bands: each gives a plane through the wire, and the lateral image what the plane leaves open.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.hole_axes import HoleEstimate
from services.registration.core.passing import AxisOffset, angle_deg, axis_offset_mm
from services.registration.core.wires_fit import WireFit, fit_wire
from services.registration.core.wires_model import wire_model
from services.registration.core.wires_view import PreparedView, WireView, prepare_view
from shared.errors import Reason, ReasonCode
from shared.geometry.frames import Guide, Nail
from shared.geometry.lines import Line
from shared.geometry.parts import GuidePart, Hole, NailPart
from shared.geometry.transform import Transform

WIRE_DIAMETER_MM = 2.0
LARGEST_OFFSET_MM, LARGEST_ANGLE_DEG = 1.0, 1.5
_LEAST_SEEN_PX, _LEAST_SEEN_FRACTION, _LEAST_DARKNESS = 7.0, 0.6, 0.5
_DIFFERENCE_MM = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class AxisComparison:
    """An axis (of a wire, or of a guide hole) against the axis of the nail hole of the same id.

    Attributes
    ----------
    offset
        Where the axis passes the nail hole's entry and exit, across the nail hole's axis, with the covariance.
    angle_deg
        Angle between both axes.
    chance_to_pass
        Probability that a 4.0 mm drill along this axis passes the nail's hole.
    """

    hole_id: str
    offset: AxisOffset
    angle_deg: float
    chance_to_pass: float


@dataclass(frozen=True, slots=True, eq=False)
class WireVerification:
    """Wires and guide holes against the nail's holes.

    Attributes
    ----------
    reasons
        Why the measurement may not be relied on; none when it may. Whether a drill would pass is another question:
        `chance_to_pass` answers it.
    wires
        Those that were found, in the order of the nail's holes, also when there are reasons.
    guide_holes
        The guide's own holes: what a drill will follow.
    """

    reasons: tuple[Reason, ...]
    wires: tuple[AxisComparison, ...]
    guide_holes: tuple[AxisComparison, ...]


def verify_wires(
    views: tuple[WireView, ...],
    guide: GuidePart,
    nail: NailPart,
    guide_from_nail: Transform[Guide, Nail],
    holes: tuple[HoleEstimate, ...],
) -> WireVerification:
    """Measure the wires in one image or more and compare them with the nail's holes.

    Parameters
    ----------
    views
        Images with the guide's pose in each; at least one.
    guide_from_nail, holes
        From an image in which the nail's holes are visible, with the guide in the same place on the bone. The errors of
        the holes are taken as independent of the wires': where both come from the same image they share the guide's
        error, and the result is on the safe side.
    """
    pairs = _paired(guide, holes)
    if not pairs:
        message = "no hole of the guide has the id of a hole of the nail; check the guide and nail files"
        return WireVerification((Reason(ReasonCode.NAIL_MODEL_MISMATCH, message),), (), ())
    prepared = tuple(prepare_view(view, guide, nail, guide_from_nail) for view in views)
    reasons: list[Reason] = []
    wires: list[AxisComparison] = []
    for guide_hole, hole in pairs:
        fit = find_wire(prepared, guide, guide_hole, hole)
        if isinstance(fit, Reason):
            reasons.append(fit)
            continue
        wires.append(compare_wire(fit, hole))
        reasons.extend(_too_uncertain(wires[-1], hole, len(views)))
    guide_holes = tuple(_compare(guide_hole.axis, np.zeros((4, 4)), hole) for guide_hole, hole in pairs)
    return WireVerification(tuple(reasons), tuple(wires), guide_holes)


def find_wire(
    views: tuple[PreparedView, ...], guide: GuidePart, guide_hole: Hole, hole: HoleEstimate
) -> WireFit | Reason:
    """The wire through one guide hole, or why there is none to be seen."""
    along_mm = float((hole.entry_guide_mm - guide_hole.axis.point_mm) @ guide_hole.axis.direction)
    fit = fit_wire(views, wire_model(guide, guide_hole, WIRE_DIAMETER_MM, along_mm))
    seen = sum(fit.seen_px)
    # Every image that should show the wire must show it: otherwise the images contradict one another.
    fractions = [s / f for s, f in zip(fit.seen_px, fit.free_px, strict=True) if f >= _LEAST_SEEN_PX]
    fraction = min(fractions, default=0.0)
    if seen >= _LEAST_SEEN_PX and fraction >= _LEAST_SEEN_FRACTION and fit.darkness >= _LEAST_DARKNESS:
        return fit
    return Reason(
        ReasonCode.WIRE_NOT_FOUND,
        f"no wire was found through guide hole '{guide_hole.id}': {seen:.0f} px of its outline were seen (limit "
        f"{_LEAST_SEEN_PX:.0f}), {100.0 * fraction:.0f} % of what is not hidden (limit "
        f"{100.0 * _LEAST_SEEN_FRACTION:.0f} %), {100.0 * max(fit.darkness, 0.0):.0f} % as dark as the nail (limit "
        f"{100.0 * _LEAST_DARKNESS:.0f} %); insert the wire up to the nail, or take an oblique image",
    )


def compare_wire(fit: WireFit, hole: HoleEstimate) -> AxisComparison:
    """A fitted wire against a nail hole, with the uncertainties of both."""

    def offset_mm(offsets_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        return axis_offset_mm(
            hole.axis_guide, fit.model.line_guide(offsets_mm), hole.entry_guide_mm, hole.exit_guide_mm
        )

    here = offset_mm(fit.offsets_mm)
    steps = np.eye(4) * _DIFFERENCE_MM
    J = np.stack([(offset_mm(fit.offsets_mm + step) - here) / _DIFFERENCE_MM for step in steps], axis=-1)
    return _compare(fit.line_guide, J @ fit.covariance_mm2 @ J.T, hole)


def _compare(line_guide: Line, covariance_mm2: NDArray[np.float64], hole: HoleEstimate) -> AxisComparison:
    mean_mm = axis_offset_mm(hole.axis_guide, line_guide, hole.entry_guide_mm, hole.exit_guide_mm)
    length_mm = float(np.linalg.norm(hole.exit_guide_mm - hole.entry_guide_mm))
    # A hole without an uncertainty is refused as such (`_too_uncertain`); here it adds nothing.
    total = covariance_mm2 if hole.offset is None else covariance_mm2 + hole.offset.covariance_mm2
    offset = AxisOffset(mean_mm, total, length_mm)
    between_deg = angle_deg(hole.axis_guide, line_guide)
    return AxisComparison(hole.id, offset, between_deg, offset.chance_to_pass(hole.diameter_mm))


def _paired(guide: GuidePart, holes: tuple[HoleEstimate, ...]) -> list[tuple[Hole, HoleEstimate]]:
    by_id = {hole.id: hole for hole in guide.holes}
    return [(by_id[hole.id], hole) for hole in holes if hole.id in by_id]


def _too_uncertain(comparison: AxisComparison, hole: HoleEstimate, image_count: int) -> list[Reason]:
    if hole.offset is None:
        message = (
            f"the uncertainty of nail hole '{hole.id}' is not known (a limit of {LARGEST_OFFSET_MM} mm needs one); "
            "locate the nail with the model method"
        )
        return [Reason(ReasonCode.UNCERTAINTY_TOO_LARGE, message)]
    bound_mm, bound_deg = comparison.offset.entry_bound_mm, comparison.offset.axis_bound_deg
    if bound_mm <= LARGEST_OFFSET_MM and bound_deg <= LARGEST_ANGLE_DEG:
        return []
    remedy = "add an image from another direction" if image_count == 1 else "take both images again with more dose"
    message = (
        f"wire '{comparison.hole_id}' is known to {bound_mm:.2f} mm and {bound_deg:.2f} degrees at 95 % (limits "
        f"{LARGEST_OFFSET_MM} mm and {LARGEST_ANGLE_DEG} degrees); {remedy}"
    )
    return [Reason(ReasonCode.UNCERTAINTY_TOO_LARGE, message)]
