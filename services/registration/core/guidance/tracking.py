"""Alignment guidance from frame to frame: a reference image localised in full, and the frames after it tracked.

In every later frame the guide is measured from where it was, and the nail from where guide and reference predict it.
The estimate is the mean of prediction and measurement, weighted by their covariances. A frame whose own pixels do not
meet every criterion is rejected with its reasons; no earlier frame stands in for it.

One thread tracks frames, another one localises a frame in full from time to time, which takes as long as many frames.
`Run` decides what each of them may still publish or change when it is done: no estimate of an older frame after a newer
one's.
"""

from collections import OrderedDict
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.frame import frame_reasons, margin_reasons
from services.registration.core.c_arm_advice import Advice, advice
from services.registration.core.estimation.pose_estimate import PoseEstimate, weighted_mean
from services.registration.core.guidance.measurement import (
    NailAppearance,
    TrackedNail,
    estimate_appearance,
    frame_evidence,
    mirror_margin,
    track_guide,
    track_nail,
)
from services.registration.core.guide.locate import locate_guide
from services.registration.core.localise import LocalisationResult, Parts, unmirrored
from services.registration.core.nail.occluders import Occluders, PlacedGuide
from services.registration.core.nail.parameters import curvature_of
from services.registration.core.nail.region import FitInput
from services.registration.core.tuning import FRAME_TRACKING
from shared.errors import Accepted, Reason, ReasonCode, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.transform import Transform

# A localisation with these reasons must not move a robot, but it is good enough to track from.
_TRACKABLE = frozenset({ReasonCode.TILT_TOO_LARGE, ReasonCode.UNCERTAINTY_TOO_LARGE})


class Origin(StrEnum):
    """How a frame was measured."""

    LOCALISED = "localised"
    FOLLOWED = "followed"


@dataclass(frozen=True, slots=True)
class Margin:
    """Confidence in the tilt's sign: as `NailEstimate.mirror_margin`, and how many frames ago it was measured."""

    log_likelihood_ratio: float | None
    frames_ago: int


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """What the next frame is tracked from; the first two by the reference, an image that was localised in full."""

    guide_from_nail: PoseEstimate[Guide, Nail]  # with the errors of the nail's pose there: the guide's are always new
    appearance: NailAppearance
    camera_from_guide: Transform[Camera, Guide]  # in the last frame in which it was found
    margin: Margin  # measured in the reference, or in the frame that was checked last
    frames_without_estimate: int  # in a row


@dataclass(frozen=True, slots=True, eq=False)
class FrameEstimate:
    """Estimate from one frame: advice, or the reasons why there is none; no pose where the guide was not found."""

    origin: Origin
    advice: Advice | None
    margin: Margin | None
    reasons: tuple[Reason, ...]
    camera_from_guide: Transform[Camera, Guide] | None


def begin_track(
    pixels: NDArray[np.float32], calibration: CArmCalibration, parts: Parts, found: LocalisationResult
) -> tuple[FrameEstimate, Track | None]:
    """Estimate from an image localised in full, and the track from it; `None` when it cannot be a reference.

    The pixels are the image as received, shape (rows, columns).
    """
    guide, nail = found.guide, found.nail
    camera_from_guide = None if guide is None else guide.camera_from_guide
    trackable = all(reason.code in _TRACKABLE for reason in found.reasons)
    if nail is None or nail.covariance is None or not trackable:
        return FrameEstimate(Origin.LOCALISED, None, None, found.reasons, camera_from_guide), None
    parts, margin = parts.with_nail_as_found(nail), Margin(nail.mirror_margin, 0)
    turn = advice(nail.camera_from_nail, nail.covariance, parts.nail)
    estimate = FrameEstimate(Origin.LOCALISED, turn, margin, (), camera_from_guide)
    if camera_from_guide is None or found.guide_from_nail is None:
        return estimate, None
    given = _given(pixels, calibration, parts, camera_from_guide)
    appearance = estimate_appearance(given, nail.camera_from_nail)
    if appearance is None:
        return estimate, None
    covariance = FRAME_TRACKING.reference_sd_factor**2 * nail.covariance
    guide_from_nail = PoseEstimate.of(found.guide_from_nail, covariance)
    return estimate, Track(guide_from_nail, appearance, camera_from_guide, margin, 0)


def track_frame(
    pixels: NDArray[np.float32], calibration: CArmCalibration, parts: Parts, track: Track
) -> tuple[FrameEstimate, Track | None]:
    """Measure one frame, given the track; also the track after it, `None` when it ends here.

    The pixels are the image as received, darker is denser, shape (rows, columns).
    """
    guide = track_guide(calibration, parts.guide, track.camera_from_guide)
    if isinstance(guide, Rejected) and track.frames_without_estimate:
        # after the view has jumped: without a prediction it takes several times as long
        found = locate_guide(unmirrored(pixels, calibration), calibration, parts.ring, parts.guide)
        guide = found if isinstance(found, Rejected) else Accepted(found.value.pose)
    if isinstance(guide, Rejected):
        return _refused(guide.reasons, None), _missed(track)
    at = guide.value.mean
    track = replace(track, camera_from_guide=at)
    parts = replace(parts, nail=parts.nail.bent(curvature_of(track.appearance.parameters)))
    given = _given(pixels, calibration, parts, at)
    predicted = guide.value @ track.guide_from_nail
    nail = track_nail(given, track.appearance, predicted.mean)
    if isinstance(nail, Rejected):
        return _refused(nail.reasons, at), _missed(track)
    reasons = frame_reasons(frame_evidence(nail.value, track.appearance, predicted))
    if reasons:
        return _refused(reasons, at), _missed(track)
    joint = weighted_mean(predicted, nail.value.pose, FRAME_TRACKING.shared_correlation)
    return _estimated(nail.value, advice(joint.mean, joint.covariance, given.nail), track)


def disagree(tracked: FrameEstimate, localised: FrameEstimate) -> bool:
    """Whether a frame's tracked estimate differs from its full localisation by more than both covariances allow."""
    first, second = tracked.advice, localised.advice
    if first is None or second is None:
        return first is not None
    apart = [
        (a.about_x_deg - b.about_x_deg, a.about_y_deg - b.about_y_deg)
        for a, b in zip(first.tilts, second.tilts, strict=True)
    ]
    variance = np.diag(first.covariance_deg2) + np.diag(second.covariance_deg2)
    return bool(np.any(np.abs(apart) > FRAME_TRACKING.contradiction_sigmas * np.sqrt(variance)))


def _estimated(nail: TrackedNail, turn: Advice, track: Track) -> tuple[FrameEstimate, Track | None]:
    """The advice, after a check of the reflected tilt when it is due."""
    margin = replace(track.margin, frames_ago=track.margin.frames_ago + 1)
    if margin.frames_ago >= FRAME_TRACKING.check_every or track.frames_without_estimate:
        margin = Margin(mirror_margin(nail), 0)
        reasons = margin_reasons(margin.log_likelihood_ratio)
        if reasons:
            return _refused(reasons, track.camera_from_guide), None
    estimate = FrameEstimate(Origin.FOLLOWED, turn, margin, (), track.camera_from_guide)
    return estimate, replace(track, margin=margin, frames_without_estimate=0)


def _refused(reasons: tuple[Reason, ...], camera_from_guide: Transform[Camera, Guide] | None) -> FrameEstimate:
    return FrameEstimate(Origin.FOLLOWED, None, None, reasons, camera_from_guide)


def _missed(track: Track) -> Track | None:
    """The track after a frame without an estimate; it ends after many, because a hand or an instrument may pass."""
    missed = track.frames_without_estimate + 1
    return replace(track, frames_without_estimate=missed) if missed < FRAME_TRACKING.most_missed else None


def _given(
    pixels: NDArray[np.float32], calibration: CArmCalibration, parts: Parts, camera_from_guide: Transform[Camera, Guide]
) -> FitInput:
    occluders = Occluders(PlacedGuide(parts.guide, camera_from_guide), parts.ring)
    return FitInput(unmirrored(pixels, calibration), calibration, parts.nail, occluders)


@dataclass(frozen=True, slots=True)
class NumberedFrame:
    """A frame: its name, and its number in order of arrival."""

    name: str
    number: int


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """What a frame is tracked from, and how many tracks had been contradicted by then."""

    track: Track | None
    contradictions: int


@dataclass(frozen=True, slots=True)
class LocalisationOutcome:
    """What a full localisation means for guidance."""

    publish: bool  # it adds to the frame's tracked estimate, and no later frame has been published
    contradicts: bool  # it differs from the frame's tracked estimate
    confirms: bool  # it agrees with the frame's tracked estimate: neither guide nor nail was moved
    starts_track: bool  # later frames are tracked from this one


@dataclass(slots=True, eq=False)
class Run:
    """The track, and the newest frames' tracked estimates. Not thread-safe."""

    track: Track | None = None  # what the next frame is tracked from; None until a frame was localised in full
    _estimates: "OrderedDict[str, FrameEstimate]" = field(default_factory=OrderedDict)
    _newest_published: int = 0
    _contradictions: int = 0
    _guide_detected_in: int = 0
    _camera_from_guide: Transform[Camera, Guide] | None = None

    def start(self) -> Start:
        """What the next frame is tracked from."""
        return Start(self.track, self._contradictions)

    def add_tracked(self, frame: NumberedFrame, start: Start, estimate: FrameEstimate, after: Track | None) -> bool:
        """Add a tracked frame and the track after it; whether its estimate may be published.

        It may not after a later frame's, nor when its start has been contradicted meanwhile.
        """
        if start.contradictions != self._contradictions:
            return False
        if self.track is start.track:  # else a full localisation has started another track meanwhile
            self.track = after
        if estimate.camera_from_guide is not None and frame.number > self._guide_detected_in:
            self._guide_detected_in, self._camera_from_guide = frame.number, estimate.camera_from_guide
            self.track = self._with_newest_guide(self.track)
        self._estimates[frame.name] = estimate
        while len(self._estimates) > FRAME_TRACKING.remembered:
            self._estimates.popitem(last=False)
        return self._is_newest(frame)

    def add_localised(self, frame: NumberedFrame, estimate: FrameEstimate, track: Track | None) -> LocalisationOutcome:
        """Add a full localisation and the track that starts there.

        The guide keeps its pose from a later frame: the C-arm has moved while this one was localised. A frame that was
        tracked, but is not localised or localised elsewhere, ends the old track: one of both estimates is wrong.
        """
        before = self._estimates.get(frame.name)
        was_tracked = before is not None and before.advice is not None
        contradicts = before is not None and disagree(before, estimate)
        if contradicts:
            self._contradictions += 1
            self.track = track
        elif track is not None or was_tracked:
            later = self._guide_detected_in > frame.number
            self.track = self._with_newest_guide(track) if later else track
        publish = (contradicts or not was_tracked) and self._is_newest(frame)
        return LocalisationOutcome(publish, contradicts, was_tracked and not contradicts, track is not None)

    def _with_newest_guide(self, track: Track | None) -> Track | None:
        if track is None or self._camera_from_guide is None:
            return track
        return replace(track, camera_from_guide=self._camera_from_guide)

    def _is_newest(self, frame: NumberedFrame) -> bool:
        if frame.number < self._newest_published:
            return False
        self._newest_published = frame.number
        return True
