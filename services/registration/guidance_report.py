"""How the C-arm looks along the holes, as messages: of a localised image, and of a frame of running fluoroscopy."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.alignment import assess, off_centre_mm, shift_in_room_mm
from services.registration.core.c_arm_advice import (
    Advice,
    AngledView,
    CArmAngles,
    HoleTilt,
    angles_after,
    display_rotation_rad,
    hole_tilts,
    middle_between_holes_mm,
)
from services.registration.core.guidance.tracking import FrameEstimate
from services.registration.core.localise import LocalisationResult, Parts
from shared.geometry.calibration import CArmCalibration
from shared.messages.base import ReasonMessage
from shared.messages.guidance import (
    Guidance,
    GuidanceUncertainty,
    GuidedHole,
    MirrorCheck,
    PositionerShift,
    PositionerTurn,
)
from shared.messages.imaging import ImageReference
from shared.messages.registration import CArmCorrection, OffCentre, ViewAssessment

# An image intensifier rotates its image by a degree or two in the earth's field; a person rotates it by more.
_SAME_DISPLAY_RAD = float(np.radians(5.0))


@dataclass(frozen=True, slots=True)
class FrameFacts:
    """What is known of a frame besides its pixels."""

    image: ImageReference
    case_id: str | None
    case_revision: int
    angles: CArmAngles | None  # None when the image does not name them
    calibration: CArmCalibration | None  # None when the ring was not found
    skipped: int
    elapsed_ms: float
    image_age_s: float | None = None  # None when nobody knows


def ring_rotation_rad(calibration: CArmCalibration) -> float:
    """Rotation of the ring, which the detector carries, about the beam in the image."""
    rotation = calibration.camera_from_ring.rotation
    return float(np.arctan2(rotation[1, 0], rotation[0, 0]))


class DisplayRotationMemory:
    """Remembers how the display is rotated against the C-arm's axes, from views of a guide that stands still.

    `rotation_rad` is None until the C-arm was turned by two degrees. It holds as long as the image is displayed as it
    was: the ring rotates with the display, and with nothing else that a C-arm does.
    """

    def __init__(self) -> None:
        self._seen: AngledView | None = None
        self._ring_rotation_rad: float | None = None
        self.rotation_rad: float | None = None

    def note(self, view: AngledView, ring_rotation_rad: float) -> None:
        """Compare a view with an earlier one from at least two degrees away."""
        turned = (
            None
            if self._ring_rotation_rad is None
            else np.angle(np.exp(1j * (ring_rotation_rad - self._ring_rotation_rad)))
        )
        if turned is None or abs(turned) > _SAME_DISPLAY_RAD:
            self._seen, self._ring_rotation_rad, self.rotation_rad = None, ring_rotation_rad, None
        if self._seen is None:
            self._seen = view
            return
        turn = display_rotation_rad(self._seen, view)
        if turn is not None:
            self._seen, self.rotation_rad = view, turn

    def forget_the_guide(self) -> None:
        """The guide may have been moved: the next view is compared with later ones only."""
        self._seen = None

    def positioner_turn(self, angles: CArmAngles, advice: Advice) -> PositionerTurn | None:
        """The correction in the C-arm's own angles; None while the display's rotation is unknown."""
        if self.rotation_rad is None:
            return None
        then = angles_after(angles, advice.correction, self.rotation_rad)
        return PositionerTurn(
            orbital=then.orbital_deg - angles.orbital_deg,
            angular=then.angular_deg - angles.angular_deg,
            orbital_then=then.orbital_deg,
            angular_then=then.angular_deg,
        )

    def positioner_shift(self, angles: CArmAngles, off_centre: NDArray[np.float64]) -> PositionerShift | None:
        """The shift that centres the holes in the C-arm's own axes; None while the display's rotation is unknown."""
        if self.rotation_rad is None:
            return None
        head, right, up = shift_in_room_mm(off_centre, angles, self.rotation_rad).tolist()
        return PositionerShift(towards_head=head, to_patients_right=right, up=up)


def guidance_message(estimate: FrameEstimate, facts: FrameFacts, display: DisplayRotationMemory) -> Guidance:
    """The message of one frame; its view is noted in `display` when it has angles and a guide."""
    if facts.angles is not None and facts.calibration is not None and estimate.camera_from_guide is not None:
        display.note(AngledView(facts.angles, estimate.camera_from_guide), ring_rotation_rad(facts.calibration))
    advice, margin = estimate.advice, estimate.margin
    off_centre = None
    if advice is not None and facts.calibration is not None:
        off_centre = off_centre_mm(facts.calibration, advice.middle_camera_mm)
    turn = None if advice is None or facts.angles is None else display.positioner_turn(facts.angles, advice)
    return Guidance(
        verdict="rejected" if advice is None else "accepted",
        reasons=tuple(ReasonMessage.of(reason) for reason in estimate.reasons),
        origin=estimate.origin.value,
        image=facts.image,
        case_id=facts.case_id,
        case_revision=facts.case_revision,
        holes=None if advice is None else tuple(_hole(tilt) for tilt in advice.tilts),
        c_arm_correction_deg=None
        if advice is None
        else CArmCorrection(about_image_x=advice.correction.about_x_deg, about_image_y=advice.correction.about_y_deg),
        positioner_turn_deg=turn,
        standard_uncertainty_deg=None
        if advice is None
        else GuidanceUncertainty(about_image_x=advice.about_x_sd_deg, about_image_y=advice.about_y_sd_deg),
        mirror_check=None
        if margin is None
        else MirrorCheck(log_likelihood_ratio=margin.log_likelihood_ratio, frames_ago=margin.frames_ago),
        skipped=facts.skipped,
        elapsed_ms=facts.elapsed_ms,
        image_age_s=facts.image_age_s,
        assessment=None if advice is None else assessment_message(advice.tilts),
        off_centre_mm=None if off_centre is None else off_centre_message(off_centre),
        positioner_shift_mm=None
        if off_centre is None or facts.angles is None
        else display.positioner_shift(facts.angles, off_centre),
    )


def _hole(tilt: HoleTilt) -> GuidedHole:
    return GuidedHole(
        id=tilt.hole_id,
        tilt_to_ray_deg=tilt.tilt_to_ray_deg,
        about_image_x=tilt.about_x_deg,
        about_image_y=tilt.about_y_deg,
    )


def assessment_message(tilts: tuple[HoleTilt, ...]) -> ViewAssessment:
    """How well the C-arm looks along the holes, as a message."""
    found = assess(tilts)
    return ViewAssessment(
        quality=found.quality.value,
        largest_tilt_deg=found.largest_tilt_deg,
        saved_by_a_degree=found.saved_by_a_degree,
    )


def off_centre_message(off_centre: NDArray[np.float64]) -> OffCentre:
    """How far the holes lie off the image's middle, as a message."""
    return OffCentre(to_image_right=float(off_centre[0]), to_image_down=float(off_centre[1]))


def view_of_nail(
    result: LocalisationResult, calibration: CArmCalibration | None, parts: Parts
) -> tuple[ViewAssessment | None, OffCentre | None]:
    """How well the C-arm looks along the holes and how far they are off the middle; None where no nail was found."""
    if calibration is None or result.nail is None:
        return None, None
    camera_from_nail, nail = result.nail.camera_from_nail, parts.with_nail_as_found(result.nail).nail
    middle_mm = middle_between_holes_mm(camera_from_nail, nail)
    return (
        assessment_message(hole_tilts(camera_from_nail, nail)),
        off_centre_message(off_centre_mm(calibration, middle_mm)),
    )
