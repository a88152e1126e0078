"""The nail in an image with wires in front of its holes: wires are found first, then modelled while the nail is fitted.

What is left of the holes' rims beside the wires, and the nail's edges, mostly tell the pose as well as a clear view
does. A wire's place in the image is known to a fraction of a pixel once its own outline has been fitted: its shadow is
then part of the model, and its pixels, with what its own error may darken, are left out.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from services.registration.core.acceptance.image import fit_reasons
from services.registration.core.acceptance.wires import BESIDE_WIRES, GUIDE_TILT, LAST_SHIFT, LAST_TURN, WIRES_LOST
from services.registration.core.fusion import LocalisedImage, usable_estimate
from services.registration.core.guide.locate import GuideFit
from services.registration.core.localise import LocalisationResult, Parts, conclude, unmirrored
from services.registration.core.nail.fit import NailFit, measure_nail
from services.registration.core.nail.occluders import Occluders, PlacedGuide, SteelRod
from services.registration.core.nail_estimate import NailEstimate, fitted_estimate
from services.registration.core.wires.fit import WIRE_DIAMETER_MM, WireFit, find_wire
from services.registration.core.wires.guided_search import nail_beside_guide
from services.registration.core.wires.image import MARGIN_PX, WireView, prepare_view
from shared.errors import Accepted, Reason, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import angle_between_rad, unit
from shared.geometry.transform import Transform

# How far around the nail no wire is looked for: while it is roughly placed, and when it has been fitted.
_ROUGHLY_PLACED_PX, _FITTED_PX = (5.0, MARGIN_PX, MARGIN_PX), (MARGIN_PX, MARGIN_PX)
_EDGE_MM = 0.35
_END_SIGMAS = 2.0
_SAME_DEG, _SAME_MM = 0.3, 0.1


def localise_behind_wires(
    upright: NDArray[np.float32],
    calibration: CArmCalibration,
    parts: Parts,
    guide: GuideFit,
    known: NailEstimate | None,
) -> LocalisationResult | None:
    """The nail in an un-mirrored image in which the guide was found, judged; None when no wire is in front of it.

    Parameters
    ----------
    known
        The nail where it was found by a fit that knows no wires, if it was.
    """
    view = WireView(upright, calibration, guide.camera_from_guide, guide.pose.covariance)
    if known is not None:
        nail = _fitted(view, parts, known.camera_from_nail, _FITTED_PX)
    else:
        start = nail_beside_guide(upright, calibration, parts.guide, parts.nail, guide.camera_from_guide)
        nail = start if isinstance(start, Rejected) else _fitted(view, parts, start.value, _ROUGHLY_PLACED_PX)
    return None if nail is None else conclude(calibration, parts, Accepted(guide), nail)


def _fitted(
    view: WireView, parts: Parts, start: Transform[Camera, Nail], margins_px: tuple[float, ...]
) -> Accepted[NailEstimate] | Rejected | None:
    """Wires, nail, and again until it stays; None when there is no wire around a nail that was fitted."""
    pose, seen = start, False
    for margin_px in margins_px:
        wires = _wires(view, parts, view.camera_from_guide.inverse() @ pose, margin_px)
        if not wires and margin_px == MARGIN_PX:
            return Rejected((WIRES_LOST.reason(),)) if seen else None
        seen = bool(wires)
        measured = _measured_beside(view, parts, pose, wires)
        if isinstance(measured, Rejected):
            return measured
        found = measured.value
        moved, pose = pose.inverse() @ found.camera_from_nail, found.camera_from_nail
        if wires and _within(moved, _SAME_DEG, _SAME_MM):
            break
    shift_mm, turn_deg = _shift_mm(moved), _turn_deg(moved)
    if not (LAST_SHIFT.is_met(shift_mm) and LAST_TURN.is_met(turn_deg)):
        quoted = f"{LAST_SHIFT.quoted(shift_mm)} and {LAST_TURN.quoted(turn_deg)}"
        return Rejected(
            (LAST_SHIFT.reason(f"nail and wires do not converge: the last fit moved the nail by {quoted}"),)
        )
    reasons = fit_reasons(replace(found.evidence, openings=BESIDE_WIRES))
    return Rejected(reasons) if reasons else Accepted(fitted_estimate(found))


def _within(motion: Transform[Nail, Nail], turn_deg: float, shift_mm: float) -> bool:
    return _turn_deg(motion) < turn_deg and _shift_mm(motion) < shift_mm


def _turn_deg(motion: Transform[Nail, Nail]) -> float:
    return float(np.degrees(np.linalg.norm(motion.rotation_vector_rad)))


def _shift_mm(motion: Transform[Nail, Nail]) -> float:
    """Across the holes: depth is neither well known nor of consequence here."""
    return float(np.linalg.norm(motion.translation_mm[:2]))


def _measured_beside(
    view: WireView, parts: Parts, start: Transform[Camera, Nail], wires: tuple[WireFit, ...]
) -> Accepted[NailFit] | Rejected:
    rods = tuple(_rod(view, wire, 0.0) for wire in wires)
    hidden = _hidden(view, tuple(_rod(view, wire, _END_SIGMAS) for wire in wires))
    placed = PlacedGuide(parts.guide, view.camera_from_guide)
    return measure_nail(view.pixels, view.calibration, parts.nail, start, Occluders(placed, parts.ring, hidden, rods))


def _wires(
    view: WireView, parts: Parts, guide_from_nail: Transform[Guide, Nail], margin_px: float
) -> tuple[WireFit, ...]:
    prepared = prepare_view(view, parts.guide, parts.nail, guide_from_nail, margin_px)
    # A wire tells nothing of the nail here: what is known of that does not matter.
    known = block_diag(view.guide_covariance, np.eye(6))
    in_nail = {hole.id for hole in parts.nail.holes}
    found = (
        find_wire((prepared,), parts.guide, hole, parts.nail, guide_from_nail, known)
        for hole in parts.guide.holes
        if hole.id in in_nail
    )
    return tuple(one for one in found if not isinstance(one, Reason))


def _rod(view: WireView, wire: WireFit, longer_sigmas: float) -> SteelRod:
    """The wire in the image, at either end so many standard deviations longer than it seems."""
    longer_mm = longer_sigmas * wire.ends_sd_mm * np.array([-1.0, 1.0])
    ends = wire.model.ends_guide_mm(wire.offsets_mm, wire.ends_mm + longer_mm)
    start, end = view.camera_from_guide.points(ends)
    return SteelRod(start, end, WIRE_DIAMETER_MM)


def _hidden(view: WireView, rods: tuple[SteelRod, ...]) -> NDArray[np.bool_]:
    """Pixels of the rods and of what their errors may darken, shape (rows, columns)."""
    mask = np.zeros(view.pixels.shape, dtype=np.uint8)
    for rod in rods:
        for x, y, radius in rod.discs_px(view.calibration, _EDGE_MM):
            cv2.circle(mask, (round(float(x)), round(float(y))), int(np.ceil(radius)), 1, thickness=-1)
    return np.asarray(mask > 0)


_TO_NAIL_MM = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class WiredImage:
    """One image with wires.

    Attributes
    ----------
    pixels
        As received, darker is denser, shape (rows, columns).
    found
        What was found in it.
    """

    pixels: NDArray[np.float32]
    found: LocalisedImage


def beside_wires(image: WiredImage, parts: Parts) -> WiredImage:
    """The image with the nail as it is found once the wires in front of it are known.

    An image whose guide was not found stays as it is, and so does one that looks at the holes from aside, where they
    cannot be open, or that shows no wire in front of them.
    """
    found, calibration = image.found, image.found.calibration
    if calibration is None or found.result is None or found.result.guide is None:
        return image
    if not GUIDE_TILT.is_met(tilt_of_guide_deg(found.result.guide, parts)):
        return image
    known = found.result.nail if usable_estimate(found, parts) is not None else None
    upright = unmirrored(image.pixels, calibration)
    result = localise_behind_wires(upright, calibration, parts, found.result.guide, known)
    if result is None:
        return image
    return replace(image, found=replace(found, result=result, reasons=result.reasons))


def why_no_holes(images: tuple[WiredImage, ...], parts: Parts) -> tuple[Reason, ...]:
    """Reasons when no image shows the nail's holes: those of the images that look along them, if there are any.

    An oblique image need not show them: that it does not is no reason.
    """
    along = [image for image in images if _looks_along(image, parts)]
    if along:
        told = (reason for image in along for reason in image.found.reasons)
        return tuple(Reason(one.code, f"{one.message}; or add an image from before the wires") for one in told)
    tilts = [tilt for image in images if (tilt := _tilt_deg(image, parts)) is not None]
    if not tilts:
        return tuple(reason for image in images for reason in image.found.reasons)
    return (
        GUIDE_TILT.reason(
            "no image looks along the nail's holes: the guide's are tilted against the beam by "
            f"{GUIDE_TILT.quoted(min(tilts))} or more"
        ),
    )


def tilt_of_guide_deg(guide: GuideFit, parts: Parts) -> float:
    """Angle between the mean direction of the guide's holes and the ray to about where they meet the nail."""
    drilling = unit(np.sum([hole.axis.direction for hole in parts.guide.holes], axis=0))
    ray = unit(guide.camera_from_guide @ (_TO_NAIL_MM * drilling))
    return float(np.degrees(angle_between_rad(guide.camera_from_guide.directions(drilling), ray)))


def _tilt_deg(image: WiredImage, parts: Parts) -> float | None:
    result = image.found.result
    return None if result is None or result.guide is None else tilt_of_guide_deg(result.guide, parts)


def _looks_along(image: WiredImage, parts: Parts) -> bool:
    tilt_deg = _tilt_deg(image, parts)
    return tilt_deg is not None and GUIDE_TILT.is_met(tilt_deg)
