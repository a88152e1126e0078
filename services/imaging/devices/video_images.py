"""Images from the frames of a video: grey, cut to the region, averaged while nothing moves."""

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from services.imaging.core.still_frames import MotionLimits, still_runs
from services.imaging.devices.video_frames import GrabbedFrames
from shared.runtime.logging import Log

# Chosen: long enough for a frame rate within 1 %, short enough to see a source that slows down.
_RATE_EVERY_S = 10.0


@dataclass(frozen=True, slots=True)
class Region:
    """The part of a frame that holds the X-ray image: left, top, width and height in pixels."""

    left: int
    top: int
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class VideoImage:
    """Average of a still run.

    Attributes
    ----------
    mean
        Shape (rows, columns), 0 to 255.
    grabbed_at_s
        When its newest frame was there, on the monotonic clock: what it shows is as old as that.
    """

    mean: NDArray[np.float32]
    grabbed_at_s: float


class VideoImages:
    """Images of one capture's frames.

    Parameters
    ----------
    grabbed
        Its frames.
    region
        What to cut out; None takes the whole frame.
    name, log
        For the log, which gets the measured rate, how many frames were dropped and how old images were.
    now_s
        The monotonic clock.
    """

    def __init__(
        self,
        grabbed: GrabbedFrames,
        region: Region | None,
        name: str,
        log: Log,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._grabbed, self._region, self._name, self._log, self._now_s = grabbed, region, name, log, now_s
        # A run ends with the newest frame, or with the one before it.
        self._grabbed_at_s: deque[float] = deque(maxlen=2)
        self._oldest_s = 0.0

    def averaged(self, limits: MotionLimits) -> Iterator[VideoImage]:
        """One image of each still run that is long enough, as soon as it is known."""
        for run in still_runs(self._frames(), limits):
            if run.frames >= limits.least_frames:
                grabbed_at_s = self._grabbed_at_s[-1 - run.frames_after]
                self._oldest_s = max(self._oldest_s, self._now_s() - grabbed_at_s)
                yield VideoImage(run.mean, grabbed_at_s)

    def _frames(self) -> Iterator[NDArray[np.float32]]:
        started_s, taken, dropped_before = self._now_s(), 0, self._grabbed.dropped()
        for frame in self._grabbed.frames:
            self._grabbed_at_s.append(frame.grabbed_at_s)
            taken += 1
            elapsed_s = self._now_s() - started_s
            if elapsed_s > _RATE_EVERY_S:
                dropped = self._grabbed.dropped() - dropped_before
                rate, age_s = round((taken + dropped) / elapsed_s, 2), round(self._oldest_s, 3)
                self._log.info("video", video=self._name, frames_per_s=rate, dropped=dropped, oldest_image_s=age_s)
                started_s, taken, dropped_before = self._now_s(), 0, dropped_before + dropped
                self._oldest_s = 0.0
            yield cut(grey_of(frame.picture), self._region)


def grey_of(frame: NDArray[np.generic]) -> NDArray[np.float32]:
    """Luminance of a frame, shape (rows, columns), 0 to 255."""
    if frame.ndim == 3 and frame.shape[2] == 3:
        return np.asarray(cv2.cvtColor(frame.astype(np.float32), cv2.COLOR_BGR2GRAY), dtype=np.float32)
    return np.asarray(frame.reshape(frame.shape[:2]), dtype=np.float32)


def cut(frame: NDArray[np.float32], region: Region | None) -> NDArray[np.float32]:
    """The region of a frame, as far as the frame reaches."""
    if region is None:
        return frame
    rows, columns = slice(region.top, region.top + region.height), slice(region.left, region.left + region.width)
    part = frame[rows, columns]
    return part if part.size else frame
