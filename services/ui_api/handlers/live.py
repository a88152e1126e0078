"""The moment, for people who turn a C-arm: the newest frame and the newest word of guidance. Never recorded.

Each frame becomes a picture once, in a process of its own (`PictureEncoder`), and only while somebody watches; all
viewers get the same one. Frames that arrive meanwhile replace one another.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

import structlog

from services.ui_api.handlers.acting import Acting
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.feed import Feed
from services.ui_api.handlers.picture_encoder import EncoderFailed, PictureEncoder
from shared.bus.frame_paths import FramePaths
from shared.bus.keys import Keys
from shared.bus.port import Bus, Sample
from shared.messages.base import decode
from shared.messages.guidance import Guidance
from shared.messages.imaging import FrameHeader
from shared.threads import supervised_thread

_log = structlog.stdlib.get_logger("distalock.ui_api")

# Chosen: an encoder that ends at once is not started in a tight loop.
_AGAIN_AFTER_S: Final = 0.5
# The encoder answers or is given up before that.
_LEAVE_WITHIN_S: Final = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class LiveFrame:
    """A frame as people see it: a JPEG of 8 bits, as received."""

    header: FrameHeader
    jpeg: bytes
    heard_at_s: float  # on the gateway's own monotonic clock


@dataclass(frozen=True, slots=True, eq=False)
class HeardGuidance:
    """A word of guidance, and when it was heard on the gateway's own monotonic clock."""

    guidance: Guidance
    heard_at_s: float


@dataclass(frozen=True, slots=True, eq=False)
class _HeardFrame:
    header: FrameHeader
    payload: bytes
    heard_at_s: float


class LiveHandler:
    """Keeps the newest picture and the newest guidance; `feed` wakes those who watch.

    Attributes
    ----------
    viewers
        How many watch: event loops, each of which may show the picture to many.
    """

    def __init__(self, bus: Bus, keys: Keys, clock: Clock, encoder: PictureEncoder, acting: Acting) -> None:
        self._bus, self._keys, self._clock, self._encoder, self._acting = bus, keys, clock, encoder, acting
        self._changed = threading.Condition()
        self._heard: _HeardFrame | None = None
        self._taken: _HeardFrame | None = None
        self._frame: LiveFrame | None = None
        self._guidance: HeardGuidance | None = None
        self.viewers = 0
        self.paths = FramePaths()
        self._thread = supervised_thread("live pictures", self._work)
        self.feed = Feed()

    def start(self) -> None:
        """Begin to listen."""
        self._thread.start()
        self._bus.subscribe(self._keys.frame, self._on_frame)
        self._bus.subscribe(self._keys.guidance, self._on_guidance)

    def close(self) -> None:
        """Send the watchers home."""
        self.feed.close()
        with self._changed:
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(_LEAVE_WITHIN_S)

    @contextmanager
    def watching(self, waker: Callable[[], None]) -> Iterator[None]:
        """Have pictures made, and be woken for each, for as long as the context lasts."""
        with self.feed.listening(waker):
            self._count_viewers(1)
            try:
                yield
            finally:
                self._count_viewers(-1)

    @property
    def frame(self) -> LiveFrame | None:
        """The newest frame that has a picture."""
        with self._changed:
            return self._frame

    def guidance(self, case_id: str | None) -> HeardGuidance | None:
        """The newest word about a case; None when there was none since the gateway started."""
        with self._changed:
            heard = self._guidance
        return heard if heard is not None and heard.guidance.case_id == case_id else None

    def heard_s_ago(self, heard: HeardGuidance | LiveFrame) -> float:
        """How long ago a word or a frame was heard."""
        return self._clock.monotonic_s() - heard.heard_at_s

    def _count_viewers(self, more: int) -> None:
        with self._changed:
            self.viewers += more
            self._changed.notify_all()

    def _on_frame(self, sample: Sample) -> None:
        self.paths.note(sample)
        header = decode(FrameHeader, sample.attachment)
        header.pixels(sample.payload)  # refuses what does not fit, before the encoder waits for pixels that never come
        heard = _HeardFrame(header, bytes(sample.payload), self._clock.monotonic_s())
        with self._changed:
            self._heard = heard
            self._changed.notify_all()

    def _on_guidance(self, sample: Sample) -> None:
        heard = HeardGuidance(decode(Guidance, sample.payload), self._clock.monotonic_s())
        with self._changed:
            before = self._guidance
            if before is not None and heard.guidance.image.precedes(before.guidance.image):
                return  # the word of an older frame, which took longer
            self._guidance = heard
        self.feed.wake()

    def _work(self) -> None:
        try:
            while (heard := self._wait_for_frame()) is not None:
                self._show(heard)
        finally:
            self._encoder.close()

    def _wait_for_frame(self) -> _HeardFrame | None:
        """The newest frame, once somebody watches and it has no picture yet; None when closed.

        While somebody acts no picture is begun: a processor that encodes is one less for what acts.
        """
        with self._changed:
            self._changed.wait_for(lambda: self.feed.closed or (self.viewers and self._heard is not self._taken))
        self._acting.wait_until_nobody()
        with self._changed:
            self._taken = self._heard
            return None if self.feed.closed else self._heard

    def _show(self, heard: _HeardFrame) -> None:
        try:
            picture = self._encoder.picture(heard.header, heard.payload)
        except EncoderFailed as error:
            _log.error("live_picture_missed", image=heard.header.sha256, detail=str(error))
            with self._changed:  # not again at once: what starts badly would fill the log
                self._changed.wait_for(lambda: self.feed.closed, _AGAIN_AFTER_S)
            return
        with self._changed:
            self._frame = LiveFrame(heard.header, picture, heard.heard_at_s)
        self.feed.wake()
