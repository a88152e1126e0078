"""State of guidance in one fluoroscopy run, and which estimates are published: of no older frame after a newer one.

One thread tracks frames, another one localises a frame in full from time to time, which takes as long as many frames.
What each of them may still publish or change when it is done is decided here.
"""

from collections import OrderedDict
from dataclasses import dataclass, field, replace

from services.registration.core.guidance.tracking import FrameEstimate, Track, disagree
from services.registration.core.tuning import FRAME_TRACKING
from shared.geometry.frames import Camera, Guide
from shared.geometry.transform import Transform


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
