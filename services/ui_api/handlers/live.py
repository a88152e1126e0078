"""The moment, for people who turn a C-arm: the newest frame and the newest word of guidance. Never recorded."""

import threading
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.feed import Feed
from shared.bus.keys import Keys
from shared.bus.port import Bus, Sample
from shared.messages.base import decode
from shared.messages.guidance import Guidance
from shared.messages.imaging import FrameHeader

_SHOWN_PERCENTILES = (0.1, 99.9)
_SAMPLED = 4
_JPEG_QUALITY = 85


@dataclass(frozen=True, slots=True, eq=False)
class LiveFrame:
    """A frame as it came in; drawn only when somebody looks."""

    header: FrameHeader
    payload: bytes
    heard_at_s: float  # on the gateway's own monotonic clock

    def jpeg(self) -> bytes:
        """The picture for people, 8 bits, as received."""
        pixels = self.header.pixels(self.payload)
        low, high = np.percentile(pixels[::_SAMPLED, ::_SAMPLED], _SHOWN_PERCENTILES)
        grey = np.clip((pixels - low) * (255.0 / max(float(high - low), 1e-6)), 0.0, 255.0).astype(np.uint8)
        return _jpeg(grey)


@dataclass(frozen=True, slots=True, eq=False)
class HeardGuidance:
    """A word of guidance, and when it was heard on the gateway's own monotonic clock."""

    guidance: Guidance
    heard_at_s: float


class LiveHandler:
    """Keeps the newest frame and the newest guidance; `feed` wakes those who watch."""

    def __init__(self, bus: Bus, keys: Keys, clock: Clock) -> None:
        self._bus, self._keys, self._clock = bus, keys, clock
        self._lock = threading.Lock()
        self._frame: LiveFrame | None = None
        self._guidance: HeardGuidance | None = None
        self.feed = Feed()

    def start(self) -> None:
        """Begin to listen."""
        self._bus.subscribe(self._keys.frame, self._on_frame)
        self._bus.subscribe(self._keys.guidance, self._on_guidance)

    def close(self) -> None:
        """Send the watchers home."""
        self.feed.close()

    @property
    def frame(self) -> LiveFrame | None:
        """The newest frame."""
        with self._lock:
            return self._frame

    def guidance(self, case_id: str | None) -> HeardGuidance | None:
        """The newest word about a case; None when there was none since the gateway started."""
        with self._lock:
            heard = self._guidance
        return heard if heard is not None and heard.guidance.case_id == case_id else None

    def heard_s_ago(self, heard: HeardGuidance | LiveFrame) -> float:
        """How long ago a word or a frame was heard."""
        return self._clock.monotonic_s() - heard.heard_at_s

    def _on_frame(self, sample: Sample) -> None:
        frame = LiveFrame(decode(FrameHeader, sample.attachment), bytes(sample.payload), self._clock.monotonic_s())
        with self._lock:
            self._frame = frame
        self.feed.wake()

    def _on_guidance(self, sample: Sample) -> None:
        heard = HeardGuidance(decode(Guidance, sample.payload), self._clock.monotonic_s())
        with self._lock:
            before = self._guidance
            if before is not None and heard.guidance.image.precedes(before.guidance.image):
                return  # the word of an older frame, which took longer
            self._guidance = heard
        self.feed.wake()


def _jpeg(grey: NDArray[np.uint8]) -> bytes:
    _, encoded = cv2.imencode(".jpg", grey, (cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY))
    return bytes(encoded.tobytes())
