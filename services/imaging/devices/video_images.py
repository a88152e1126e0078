"""Images from the frames of a video: grey, cut to the region, averaged while nothing moves, and not too old."""

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from services.imaging.core.still_frames import MotionLimits, StillRun, still_runs
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


class VideoImages:
    """Still runs of one capture's frames.

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

    def runs(self, limits: MotionLimits) -> Iterator[StillRun]:
        """Runs that are long enough, each as soon as it is known.

        Who takes an image counts its age from when it is handed on. One whose newest frame has waited for longer would
        be bound to where the robot stands by now: it is left out, and the view is averaged anew.
        """
        frames = self._frames()
        while True:
            for run in still_runs(frames, limits):
                if run.frames < limits.least_frames:
                    continue
                age_s = self._now_s() - self._grabbed_at_s[-1 - run.frames_after]
                if age_s > self._grabbed.oldest_s:
                    self._log.warning("image too old", video=self._name, detail=_too_old(age_s, self._grabbed.oldest_s))
                    break
                self._oldest_s = max(self._oldest_s, age_s)
                yield run
            else:
                return

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


def _too_old(age_s: float, limit_s: float) -> str:
    return (
        f"the newest frame of an image waited {age_s:.2f} s (limit {limit_s:g} s); the view is averaged anew; if this "
        "comes again, give imaging more processor time, or set a smaller video_region"
    )


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
