"""Alignment guidance from frame to frame: a reference image localised in full, and the frames after it tracked.

In every later frame the guide is measured from where it was, and the nail from where guide and reference predict it.
The estimate is the mean of prediction and measurement, weighted by their covariances. A frame whose own pixels do not
meet every criterion is rejected with its reasons; no earlier frame stands in for it.
"""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.frame import FrameEvidence, frame_reasons, margin_reasons
from services.registration.core.c_arm_advice import Advice, advice
from services.registration.core.estimation.pose_estimate import PoseEstimate, weighted_mean
from services.registration.core.guidance.guide_tracking import TrackedGuide, track_guide
from services.registration.core.guidance.nail_tracking import (
    NailAppearance,
    TrackedNail,
    estimate_appearance,
    mirror_margin,
    track_nail,
)
from services.registration.core.guide.locate import locate_guide
from services.registration.core.localise import LocalisationResult, Parts, unmirrored
from services.registration.core.nail.forward_model import FitInput
from services.registration.core.nail.occluders import Occluders, PlacedGuide
from shared.errors import Accepted, Reason, ReasonCode, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.transform import Transform

CHECK_EVERY = 8
MOST_MISSED = 20
_DISAGREEMENT = 4.0
# Single images are held to normalised errors of 1.25 at most; a key's error stays in all frames that follow it.
_HELD_TO = 1.25
# Correlation of a key's errors with a frame's: bone texture and display mislead both in part alike.
_SHARED = 0.5
# With these reasons a localisation is too far off or too unsure to move a robot, and yet good enough to start from.
_GOOD_ENOUGH_TO_START = frozenset({ReasonCode.TILT_TOO_LARGE, ReasonCode.UNCERTAINTY_TOO_LARGE})


class Origin(StrEnum):
    """Where an answer comes from."""

    LOCALISED = "localised"
    FOLLOWED = "followed"


@dataclass(frozen=True, slots=True)
class Margin:
    """Confidence in the tilt's sign: as `NailEstimate.mirror_margin`, and how many frames ago it was measured."""

    log_likelihood_ratio: float | None
    frames_ago: int


@dataclass(frozen=True, slots=True, eq=False)
class Key:
    """A fully localised image, as far as later frames need it.

    Attributes
    ----------
    guide_from_nail
        With the errors of the nail's pose in the key; the guide's are new in every frame.
    """

    guide_from_nail: PoseEstimate[Guide, Nail]
    appearance: NailAppearance


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """What one frame hands on to the next.

    Attributes
    ----------
    camera_from_guide
        In the last frame in which it was found.
    margin
        Measured in the key, or in the frame that was checked last.
    frames_without_estimate
        Frames in a row without an answer.
    """

    key: Key
    camera_from_guide: Transform[Camera, Guide]
    margin: Margin
    frames_without_estimate: int


@dataclass(frozen=True, slots=True, eq=False)
class FrameEstimate:
    """What one frame says: advice, or the reasons why there is none.

    Attributes
    ----------
    camera_from_guide
        Of this frame; None where the guide was not found.
    """

    origin: Origin
    advice: Advice | None
    margin: Margin | None
    reasons: tuple[Reason, ...]
    camera_from_guide: Transform[Camera, Guide] | None


def start_track(
    pixels: NDArray[np.float32], calibration: CArmCalibration, parts: Parts, found: LocalisationResult
) -> Track | None:
    """Make an image that was localised in full a key; `None` when it cannot be one.

    Parameters
    ----------
    pixels
        The image as received.
    found
        Its localisation.
    """
    guide, nail = found.guide, found.nail
    usable = all(reason.code in _GOOD_ENOUGH_TO_START for reason in found.reasons)
    if guide is None or nail is None or found.guide_from_nail is None or nail.covariance is None or not usable:
        return None
    given = _given(pixels, calibration, parts, guide.camera_from_guide)
    appearance = estimate_appearance(given, nail.camera_from_nail)
    if appearance is None:
        return None
    key = Key(PoseEstimate.of(found.guide_from_nail, _HELD_TO**2 * nail.covariance), appearance)
    return Track(key, guide.camera_from_guide, Margin(nail.mirror_margin, 0), 0)


def estimate_of_localisation(found: LocalisationResult, parts: Parts) -> FrameEstimate:
    """What a full localisation says, in the same words."""
    nail = found.nail
    guide = None if found.guide is None else found.guide.camera_from_guide
    blocking = tuple(reason for reason in found.reasons if reason.code not in _GOOD_ENOUGH_TO_START)
    if nail is None or nail.covariance is None or blocking:
        return FrameEstimate(Origin.LOCALISED, None, None, found.reasons, guide)
    told = advice(nail.camera_from_nail, nail.covariance, parts.nail)
    return FrameEstimate(Origin.LOCALISED, told, Margin(nail.mirror_margin, 0), (), guide)


def track_frame(
    pixels: NDArray[np.float32], calibration: CArmCalibration, parts: Parts, track: Track
) -> tuple[FrameEstimate, Track | None]:
    """Measure one frame with the help of the track; the track goes on, or ends (`None`) when it cannot be trusted.

    Parameters
    ----------
    pixels
        The image as received, darker is denser, shape (rows, columns).
    calibration
        Of the same image.
    """
    guide = track_guide(calibration, parts.guide, track.camera_from_guide)
    if isinstance(guide, Rejected) and track.frames_without_estimate:
        guide = _found_anew(pixels, calibration, parts)
    if isinstance(guide, Rejected):
        return _refused(guide.reasons, None), _missed(track)
    at = guide.value.pose.mean
    track = replace(track, camera_from_guide=at)
    given = _given(pixels, calibration, parts, at)
    predicted = guide.value.pose @ track.key.guide_from_nail
    nail = track_nail(given, track.key.appearance, predicted.mean)
    if isinstance(nail, Rejected):
        return _refused(nail.reasons, at), _missed(track)
    observed = PoseEstimate.of(nail.value.camera_from_nail, nail.value.covariance)
    reasons = frame_reasons(_evidence(nail.value, track.key.appearance, observed, predicted))
    if reasons:
        return _refused(reasons, at), _missed(track)
    joint = weighted_mean(predicted, observed, _SHARED)
    return _answered(nail.value, advice(joint.mean, joint.covariance, parts.nail), track)


def disagree(followed: FrameEstimate, localised: FrameEstimate) -> bool:
    """Whether what a frame said when it was followed differs from its full localisation by more than both allow."""
    first, second = followed.advice, localised.advice
    if first is None or second is None:
        return first is not None
    apart = [
        (a.about_x_deg - b.about_x_deg, a.about_y_deg - b.about_y_deg)
        for a, b in zip(first.tilts, second.tilts, strict=True)
    ]
    variance = np.diag(first.covariance_deg2) + np.diag(second.covariance_deg2)
    return bool(np.any(np.abs(apart) > _DISAGREEMENT * np.sqrt(variance)))


def _found_anew(
    pixels: NDArray[np.float32], calibration: CArmCalibration, parts: Parts
) -> Accepted[TrackedGuide] | Rejected:
    """The guide from nothing, wherever the view has jumped: takes several times as long as following it."""
    found = locate_guide(unmirrored(pixels, calibration), calibration, parts.ring, parts.guide)
    if isinstance(found, Rejected):
        return found
    fit = found.value
    return Accepted(TrackedGuide(fit.pose, fit.balls_found, fit.reprojection_rms_px))


def _answered(nail: TrackedNail, told: Advice, track: Track) -> tuple[FrameEstimate, Track | None]:
    """The advice, after a check of the reflected tilt when it is due."""
    margin = replace(track.margin, frames_ago=track.margin.frames_ago + 1)
    if margin.frames_ago >= CHECK_EVERY or track.frames_without_estimate:
        margin = Margin(mirror_margin(nail), 0)
        reasons = margin_reasons(margin.log_likelihood_ratio)
        if reasons:
            return _refused(reasons, track.camera_from_guide), None
    sight = FrameEstimate(Origin.FOLLOWED, told, margin, (), track.camera_from_guide)
    return sight, replace(track, margin=margin, frames_without_estimate=0)


def _refused(reasons: tuple[Reason, ...], camera_from_guide: Transform[Camera, Guide] | None) -> FrameEstimate:
    return FrameEstimate(Origin.FOLLOWED, None, None, reasons, camera_from_guide)


def _missed(track: Track) -> Track | None:
    """A hand or an instrument may go by: for a while the next frame tries again from the same key."""
    return (
        replace(track, frames_without_estimate=track.frames_without_estimate + 1)
        if track.frames_without_estimate + 1 < MOST_MISSED
        else None
    )


def _given(
    pixels: NDArray[np.float32], calibration: CArmCalibration, parts: Parts, camera_from_guide: Transform[Camera, Guide]
) -> FitInput:
    occluders = Occluders(PlacedGuide(parts.guide, camera_from_guide), parts.ring)
    return FitInput(unmirrored(pixels, calibration), calibration, parts.nail, occluders)


def _evidence(
    nail: TrackedNail,
    appearance: NailAppearance,
    observed: PoseEstimate[Camera, Nail],
    predicted: PoseEstimate[Camera, Nail],
) -> FrameEvidence:
    """The observed nail, and how far it lies from where guide and key predict it."""
    apart = predicted.mean.inverse() @ observed.mean
    rotation = observed.covariance[:2, :2] + predicted.covariance[:2, :2]
    return FrameEvidence(
        holes=nail.holes,
        structure=nail.structure,
        unexplained=nail.unexplained,
        turned_deg=tuple(np.degrees(apart.rotation_vector_rad[:2]).tolist()),
        turn_sd_deg=tuple(np.degrees(np.sqrt(np.diag(rotation))).tolist()),
        across_mm=float(np.linalg.norm(apart.translation_mm[:2])),
        blur_px=nail.blur_px,
        key_blur_px=appearance.blur_px,
        tilt_sd_deg=float(np.degrees(np.sqrt(np.diag(nail.covariance)[:2].max()))),
    )
