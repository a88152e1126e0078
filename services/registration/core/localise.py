"""From one calibrated image to the nail's hole axes in the guide's frame: guide, nail, axes, acceptance."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.image import Departures, LocalisationEvidence, localisation_reasons
from services.registration.core.c_arm_advice import CArmTurn, c_arm_correction_deg
from services.registration.core.guide.locate import GuideFit, locate_guide
from services.registration.core.guide_from_nail import NailEstimate, guide_from_nail_of
from services.registration.core.hole_axes import HoleEstimate, holes_at, holes_of_guide
from services.registration.core.nail.fit import fit_nail
from services.registration.core.nail.left_out import clipped_pixels, covered_pixels
from services.registration.core.nail.occluders import Occluders, PlacedGuide, ball_discs_px
from services.registration.core.nail.region import FitInput
from services.registration.core.nail.search.find import find_nail
from shared.errors import Accepted, Reason, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Guide, Nail
from shared.geometry.parts import GuidePart, NailPart, RingPart
from shared.geometry.transform import Transform
from shared.xray.dead_pixels import FilledImage, fill_dead_pixels


class LocalisationStep(StrEnum):
    """Steps of a localisation, for those who measure its time."""

    GUIDE = "guide"
    NAIL = "nail"


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """The known shapes in the image, and the drill that is to pass the nail's holes.

    Of the nail's holes those that are drilled with this guide are localised (`holes_of_guide`).
    """

    ring: RingPart
    guide: GuidePart
    nail: NailPart
    drill_diameter_mm: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "nail", holes_of_guide(self.nail, self.guide))

    def with_nail_as_found(self, found: NailEstimate) -> "Parts":
        """The same with the nail as it was found."""
        return replace(self, nail=found.nail_as_found(self.nail))


@dataclass(frozen=True, slots=True, eq=False)
class LocalisationResult:
    """Estimates from one image. Without reasons it is accepted, and then no field is None."""

    reasons: tuple[Reason, ...]  # why it is rejected
    # What was found, also on rejection
    guide: GuideFit | None
    nail: NailEstimate | None
    guide_from_nail: Transform[Guide, Nail] | None
    holes: tuple[HoleEstimate, ...] | None
    correction: CArmTurn | None

    @property
    def accepted(self) -> bool:
        """Whether a robot may be moved by it."""
        return not self.reasons


def localise(
    pixels: NDArray[np.float32],
    calibration: CArmCalibration,
    parts: Parts,
    completed: Callable[[LocalisationStep], None] = lambda _: None,
) -> LocalisationResult:
    """Find guide and nail in a calibrated image, and accept or reject the localisation.

    Guide and nail are both searched for, so that all reasons against an image are reported at once.

    The pixels are the image as received, darker is denser, shape (rows, columns); `completed` is called after each
    step.
    """
    filled = fill_dead_pixels(unmirrored(pixels, calibration))
    guide = locate_guide(filled.pixels, calibration, parts.ring, parts.guide)
    completed(LocalisationStep.GUIDE)
    nail = _locate_nail(filled, calibration, parts, guide.value if isinstance(guide, Accepted) else None)
    completed(LocalisationStep.NAIL)
    return conclude(calibration, parts, guide, nail)


def unmirrored(pixels: NDArray[np.float32], calibration: CArmCalibration) -> NDArray[np.float32]:
    """The image in the calibration's pixels: columns reversed when the display mirrored it."""
    return np.ascontiguousarray(pixels[:, ::-1]) if calibration.mirrored else pixels


def conclude(
    calibration: CArmCalibration,
    parts: Parts,
    guide: Accepted[GuideFit] | Rejected,
    nail: Accepted[NailEstimate] | Rejected,
) -> LocalisationResult:
    """Combine guide and nail, and accept or reject; what was not found is left out and its reasons are reported."""
    found_guide = guide.value if isinstance(guide, Accepted) else None
    found_nail = nail.value if isinstance(nail, Accepted) else None
    parts = parts if found_nail is None else parts.with_nail_as_found(found_nail)
    correction = None if found_nail is None else c_arm_correction_deg(found_nail.camera_from_nail, parts.nail)
    if found_guide is None or found_nail is None or correction is None:
        reasons = tuple(r for part in (guide, nail) if isinstance(part, Rejected) for r in part.reasons)
        return LocalisationResult(reasons, found_guide, found_nail, None, None, correction)
    camera_from_nail = found_nail.camera_from_nail
    guide_from_nail = found_guide.camera_from_guide.inverse() @ camera_from_nail
    holes = hole_estimates(calibration, parts, found_guide, found_nail)
    reasons = localisation_reasons(
        LocalisationEvidence(
            calibration,
            parts.guide,
            parts.nail,
            camera_from_nail,
            guide_from_nail,
            holes,
            correction,
            departures_of(calibration, found_guide, found_nail),
        )
    )
    return LocalisationResult(reasons, found_guide, found_nail, guide_from_nail, holes, correction)


def departures_of(calibration: CArmCalibration, guide: GuideFit, nail: NailEstimate) -> Departures:
    """What ring, guide and nail show to be otherwise than modelled."""
    return Departures(
        error_ratio=nail.error_ratio,
        beside_objects=nail.beside_objects,
        second_bore_deg=nail.second_bore_deg,
        channel_deg=nail.channel_deg,
        display_turn_deg=nail.display_turn_deg,
        other_bend_deg=nail.other_bend_deg,
        lag_px=guide.lag_px,
        guide_spread_mm=guide.displacement_sd_mm,
        ring_spread_mm=calibration.ring_spread_mm,
        hole_spread_mm=nail.hole_spread_mm,
    )


def hole_estimates(
    calibration: CArmCalibration, parts: Parts, guide_fit: GuideFit, estimate: NailEstimate
) -> tuple[HoleEstimate, ...]:
    """All holes of the nail in the guide's frame, in the order of the nail's file."""
    parts = parts.with_nail_as_found(estimate)
    estimated = guide_from_nail_of(calibration, parts.guide, parts.nail, guide_fit, estimate)
    guide_from_nail = guide_fit.camera_from_guide.inverse() @ estimate.camera_from_nail
    covariance = None if estimated is None else estimated.errors.covariance_with_bend
    return holes_at(parts.nail, parts.drill_diameter_mm, guide_from_nail, covariance, estimate.camera_from_nail)


def distal_direction(guide: GuideFit | None) -> NDArray[np.float64] | None:
    """Rough direction of the nail's +x in the camera's frame, shape (3,): the guide's +x."""
    return None if guide is None else guide.camera_from_guide.directions(np.array([1.0, 0.0, 0.0]))


def known_balls(parts: Parts, guide: GuideFit | None) -> Occluders:
    """What lies over the nail: the ring, and the guide where it was found."""
    placed = None if guide is None else PlacedGuide(parts.guide, guide.camera_from_guide)
    return Occluders(placed, parts.ring)


def _locate_nail(
    filled: FilledImage, calibration: CArmCalibration, parts: Parts, guide: GuideFit | None
) -> Accepted[NailEstimate] | Rejected:
    """Search the nail, then fit it to the pixels that show it: not covered, not clipped, not dead."""
    upright = filled.pixels
    found = find_nail(upright, calibration, parts.nail, distal_direction(guide))
    if isinstance(found, Rejected):
        return found
    start = found.value
    balls = known_balls(parts, guide)
    depth_mm = float(start.camera_from_nail.translation_mm[2])
    hidden = covered_pixels(upright, calibration, start.openings, depth_mm, ball_discs_px(balls, calibration))
    balls = replace(balls, hidden=hidden | clipped_pixels(upright) | filled.dead)
    fit = fit_nail(FitInput(upright, calibration, parts.nail, balls), start.camera_from_nail)
    return fit if isinstance(fit, Rejected) else Accepted(NailEstimate.of_fit(fit.value))
