"""Verify K-wires: their axes, as one image or a pair shows them, against the axes of the nail's holes.

Images of a pair are tied together by the guide, which is found in each of them: everything is expressed in its frame.
The lateral image shows the nail's holes, and the wires nearly end on, as stubs in the holes' openings. An oblique image
shows the wires as bands: each gives a plane through the wire, and the lateral image what the plane leaves open.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.wires_fit import WireFit, fit_wire
from services.registration.core.wires_model import wire_model
from services.registration.core.wires_view import WireView, prepare_view
from shared.errors import Reason, ReasonCode
from shared.geometry.frames import Guide, Nail
from shared.geometry.lines import Line, across_axis_offset_mm, angle_between_rad
from shared.geometry.parts import GuidePart, Hole, NailPart, hole_surface_points
from shared.geometry.transform import Transform

WIRE_DIAMETER_MM = 2.0
DRILL_DIAMETER_MM = 4.0
LARGEST_OFFSET_95_MM, LARGEST_ANGLE_95_DEG = 1.0, 1.5
_BOUND_95 = 2.0
_LEAST_SEEN_PX, _LEAST_SEEN_FRACTION, _LEAST_DARKNESS = 7.0, 0.6, 0.5
_DIFFERENCE_MM = 1e-4
_SAMPLES = 20_000
_SEED = 20030101


@dataclass(frozen=True, slots=True)
class AxisUncertainty:
    """Predicted rms of the two errors that count: across the axis at the entry, and of the direction."""

    entry_mm: float
    axis_deg: float


@dataclass(frozen=True, slots=True)
class AxisComparison:
    """An axis (of a wire, or of a guide hole) against the axis of the nail hole of the same id.

    Attributes
    ----------
    entry_offset_mm, exit_offset_mm
        Distance across the nail hole's axis where that enters and where it leaves the nail.
    angle_deg
        Angle between both axes.
    uncertainty
        Of the offset at the entry and of the angle.
    chance_to_pass
        Probability that a drill along this axis passes the nail's hole.
    """

    hole_id: str
    entry_offset_mm: float
    exit_offset_mm: float
    angle_deg: float
    uncertainty: AxisUncertainty
    chance_to_pass: float


@dataclass(frozen=True, slots=True)
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
    nail_uncertainty: Mapping[str, AxisUncertainty],
) -> WireVerification:
    """Measure the wires in one image or more and compare them with the nail's holes.

    Parameters
    ----------
    views
        Images with the guide's pose in each; at least one.
    guide_from_nail
        From an image in which the nail's holes are visible, with the same guide position.
    nail_uncertainty
        Of the nail holes' axes in the guide's frame, by hole id. Taken as independent of the wires' errors: where both
        come from the same image they share the guide's, and the result is on the safe side.
    """
    pairs = paired_holes(guide, nail)
    if not pairs:
        message = "no hole of the guide has the id of a hole of the nail; check the guide and nail files"
        return WireVerification((Reason(ReasonCode.NAIL_MODEL_MISMATCH, message),), (), ())
    prepared = tuple(prepare_view(view, guide, nail, guide_from_nail) for view in views)
    reasons, wires, guide_holes = [], [], []
    for guide_hole, nail_hole in pairs:
        known = nail_uncertainty[nail_hole.id]
        guide_holes.append(_compare_exact(guide_hole.axis, nail, nail_hole, guide_from_nail, known))
        entry_guide = guide_from_nail @ hole_surface_points(nail, nail_hole)[0]
        along_mm = float((entry_guide - guide_hole.axis.point_mm) @ guide_hole.axis.direction)
        fit = fit_wire(prepared, wire_model(guide, guide_hole, WIRE_DIAMETER_MM, along_mm))
        missing = _not_found(fit)
        if missing is not None:
            reasons.append(missing)
            continue
        comparison = compare_axes(fit, nail, nail_hole, guide_from_nail, known)
        wires.append(comparison)
        reasons.extend(_too_uncertain(comparison, len(views)))
    return WireVerification(tuple(reasons), tuple(wires), tuple(guide_holes))


def paired_holes(guide: GuidePart, nail: NailPart) -> tuple[tuple[Hole, Hole], ...]:
    """Holes of guide and nail with the same id, in the nail's order."""
    by_id = {hole.id: hole for hole in guide.holes}
    return tuple((by_id[hole.id], hole) for hole in nail.holes if hole.id in by_id)


def compare_axes(
    fit: WireFit,
    nail: NailPart,
    nail_hole: Hole,
    guide_from_nail: Transform[Guide, Nail],
    nail_uncertainty: AxisUncertainty,
) -> AxisComparison:
    """A fitted wire against a nail hole, with both uncertainties."""
    nail_from_guide = guide_from_nail.inverse()

    def offsets(offsets_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        return _offsets_mm(_moved(fit.model.line_guide(offsets_mm), nail_from_guide), nail, nail_hole)

    here = offsets(fit.offsets_mm)
    steps = np.eye(4) * _DIFFERENCE_MM
    derivative = np.stack([(offsets(fit.offsets_mm + step) - here) / _DIFFERENCE_MM for step in steps], axis=-1)
    covariance = derivative @ fit.covariance_mm2 @ derivative.T
    line = _moved(fit.line_guide, nail_from_guide)
    return _comparison(line, nail, nail_hole, here, covariance, nail_uncertainty)


def _compare_exact(
    axis_guide: Line,
    nail: NailPart,
    nail_hole: Hole,
    guide_from_nail: Transform[Guide, Nail],
    nail_uncertainty: AxisUncertainty,
) -> AxisComparison:
    line = _moved(axis_guide, guide_from_nail.inverse())
    return _comparison(line, nail, nail_hole, _offsets_mm(line, nail, nail_hole), np.zeros((4, 4)), nail_uncertainty)


def _comparison(
    line_nail: Line,
    nail: NailPart,
    nail_hole: Hole,
    offsets_mm: NDArray[np.float64],
    covariance_mm2: NDArray[np.float64],
    nail_uncertainty: AxisUncertainty,
) -> AxisComparison:
    entry, leaving = hole_surface_points(nail, nail_hole)
    length_mm = float(np.linalg.norm(leaving - entry))
    total = covariance_mm2 + _nail_covariance_mm2(nail_uncertainty, length_mm)
    slope = np.hstack([-np.eye(2), np.eye(2)]) / length_mm
    uncertainty = AxisUncertainty(
        float(np.sqrt(np.trace(total[:2, :2]))), float(np.degrees(np.sqrt(np.trace(slope @ total @ slope.T))))
    )
    return AxisComparison(
        nail_hole.id,
        across_axis_offset_mm(nail_hole.axis, line_nail, entry),
        across_axis_offset_mm(nail_hole.axis, line_nail, leaving),
        float(np.degrees(angle_between_rad(nail_hole.axis.direction, line_nail.direction))),
        uncertainty,
        chance_to_pass(offsets_mm, total, 0.5 * (nail_hole.diameter_mm - DRILL_DIAMETER_MM)),
    )


def chance_to_pass(
    offsets_mm: NDArray[np.float64], covariance_mm2: NDArray[np.float64], largest_offset_mm: float
) -> float:
    """Probability that an axis is within an offset of the hole's axis at its entry and at its exit.

    Parameters
    ----------
    offsets_mm
        Offset at the entry (two components) and at the exit (two), shape (4,).
    covariance_mm2
        Shape (4, 4).
    largest_offset_mm
        Half the difference of the hole's and the drill's diameters.
    """
    if largest_offset_mm <= 0.0:
        return 0.0
    values, vectors = np.linalg.eigh(covariance_mm2)
    draws = np.random.default_rng(_SEED).standard_normal((_SAMPLES, 4))
    samples = offsets_mm + draws * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    inside = (np.hypot(samples[:, 0], samples[:, 1]) <= largest_offset_mm) & (
        np.hypot(samples[:, 2], samples[:, 3]) <= largest_offset_mm
    )
    return float(np.mean(inside))


def _nail_covariance_mm2(uncertainty: AxisUncertainty, length_mm: float) -> NDArray[np.float64]:
    """Covariance of offsets at entry and exit from that of the nail's axis: alike in all directions, shape (4, 4)."""
    place = 0.5 * uncertainty.entry_mm**2
    turn = 0.5 * (np.radians(uncertainty.axis_deg) * length_mm) ** 2
    return np.kron(np.array([[place, place], [place, place + turn]]), np.eye(2))


def _moved(line_guide: Line, nail_from_guide: Transform[Nail, Guide]) -> Line:
    return Line(nail_from_guide @ line_guide.point_mm, nail_from_guide.directions(line_guide.direction))


def _offsets_mm(line_nail: Line, nail: NailPart, nail_hole: Hole) -> NDArray[np.float64]:
    """Where a line passes the hole's entry and exit, across the hole's axis, in two directions each, shape (4,)."""
    direction = nail_hole.axis.direction
    first = np.cross(direction, np.array([1.0, 0.0, 0.0]))
    first = first / np.linalg.norm(first)
    across = np.stack([first, np.cross(direction, first)])
    points = hole_surface_points(nail, nail_hole)
    return np.concatenate([across @ (line_nail.at_plane(point, direction) - point) for point in points])


def _not_found(fit: WireFit) -> Reason | None:
    seen, free = sum(fit.seen_px), sum(fit.free_px)
    fraction = seen / free if free > 0.0 else 0.0
    if seen >= _LEAST_SEEN_PX and fraction >= _LEAST_SEEN_FRACTION and fit.darkness >= _LEAST_DARKNESS:
        return None
    return Reason(
        ReasonCode.WIRE_NOT_FOUND,
        f"no wire through guide hole '{fit.model.hole.id}': {seen:.0f} px of its outline were seen (limit "
        f"{_LEAST_SEEN_PX:.0f}), {100.0 * fraction:.0f} % of what is not hidden (limit "
        f"{100.0 * _LEAST_SEEN_FRACTION:.0f} %), {100.0 * max(fit.darkness, 0.0):.0f} % as dark as the nail (limit "
        f"{100.0 * _LEAST_DARKNESS:.0f} %); insert the wire up to the nail, or take an oblique image",
    )


def _too_uncertain(comparison: AxisComparison, image_count: int) -> list[Reason]:
    offset_mm = _BOUND_95 * comparison.uncertainty.entry_mm
    angle_deg = _BOUND_95 * comparison.uncertainty.axis_deg
    if offset_mm <= LARGEST_OFFSET_95_MM and angle_deg <= LARGEST_ANGLE_95_DEG:
        return []
    remedy = "add an image from another direction" if image_count == 1 else "take both images again with more dose"
    message = (
        f"wire '{comparison.hole_id}' is known to {offset_mm:.2f} mm and {angle_deg:.2f} degrees at 95 % (limits "
        f"{LARGEST_OFFSET_95_MM} mm and {LARGEST_ANGLE_95_DEG} degrees); {remedy}"
    )
    return [Reason(ReasonCode.UNCERTAINTY_TOO_LARGE, message)]
