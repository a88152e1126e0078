"""What is known while frames of one set-up come in, and what may be said of them: of no older frame after a newer one.

Two hands work on it, one that follows frames and one that now and then localises one of them in full, which takes many
frames' time. So each finds, when it is done, that the other has gone on meanwhile.
"""

from collections import OrderedDict
from dataclasses import dataclass, field, replace

from services.registration.core.guidance.tracking import FrameEstimate, Track, disagree
from shared.geometry.frames import Camera, Guide
from shared.geometry.transform import Transform

_REMEMBERED = 64


@dataclass(frozen=True, slots=True)
class Arrival:
    """A frame: its name, and its number in the order in which frames arrived."""

    name: str
    number: int


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """What a frame is followed from.

    Attributes
    ----------
    contradictions
        How often guidance had been contradicted by then.
    """

    track: Track | None
    contradictions: int


@dataclass(frozen=True, slots=True)
class Finding:
    """What a full localisation means for guidance.

    Attributes
    ----------
    tell
        Whether it is to be told: it says more than the frame said when it was followed, and no later frame was told of.
    contradicts
        Whether the frame, when it was followed, said something else.
    continues
        Whether the frame, when it was followed, said the same: neither guide nor nail was moved.
    begins
        Whether later frames are followed from this one.
    """

    tell: bool
    contradicts: bool
    continues: bool
    begins: bool


@dataclass(slots=True, eq=False)
class Run:
    """The track, and what was said of the newest frames. Not for several threads.

    Attributes
    ----------
    track
        What the next frame is followed from; None until a frame was localised in full.
    """

    track: Track | None = None
    _said: "OrderedDict[str, FrameEstimate]" = field(default_factory=OrderedDict)
    _told_of: int = 0
    _contradictions: int = 0
    _guide_seen_in: int = 0
    _camera_from_guide: Transform[Camera, Guide] | None = None

    def start(self) -> Start:
        """What the next frame is followed from."""
        return Start(self.track, self._contradictions)

    def followed(self, frame: Arrival, start: Start, sight: FrameEstimate, after: Track | None) -> bool:
        """Take what a frame said, and the track after it; whether it may be told.

        Not when a later frame was told of, nor when what the frame was followed from was contradicted meanwhile.
        """
        if start.contradictions != self._contradictions:
            return False
        if self.track is start.track:  # else a full localisation has begun anew meanwhile
            self.track = after
        if sight.camera_from_guide is not None and frame.number > self._guide_seen_in:
            self._guide_seen_in, self._camera_from_guide = frame.number, sight.camera_from_guide
            self.track = self._with_newest_guide(self.track)
        self._said[frame.name] = sight
        while len(self._said) > _REMEMBERED:
            self._said.popitem(last=False)
        return self._is_news(frame)

    def localised(self, frame: Arrival, sight: FrameEstimate, track: Track | None) -> Finding:
        """Take what a full localisation said of a frame, and the track that begins there.

        The guide stays where a later frame showed it: the C-arm has been turned while the frame was localised. A frame
        that was followed and yet cannot be localised, or otherwise, ends the old track: one of the two is wrong.
        """
        said = self._said.get(frame.name)
        answered = said is not None and said.advice is not None
        contradicts = said is not None and disagree(said, sight)
        if contradicts:
            self._contradictions += 1
            self.track = track
        elif track is not None or answered:
            later = self._guide_seen_in > frame.number
            self.track = self._with_newest_guide(track) if later else track
        tell = (contradicts or not answered) and self._is_news(frame)
        return Finding(tell, contradicts, answered and not contradicts, track is not None)

    def _with_newest_guide(self, track: Track | None) -> Track | None:
        if track is None or self._camera_from_guide is None:
            return track
        return replace(track, camera_from_guide=self._camera_from_guide)

    def _is_news(self, frame: Arrival) -> bool:
        if frame.number < self._told_of:
            return False
        self._told_of = frame.number
        return True
