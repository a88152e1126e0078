"""Average frames as long as nothing moves: noise goes down, and motion is detected instead of smeared.

Two frames differ by their noise, by the brightness control's gain, and where something moved. Means over blocks
separate motion from noise: noise hardly changes them, a ball's edge that moved by half a pixel does.
"""

import sys
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from services.imaging.core.tuning import STILL_FRAMES
from shared.xray.tuning import DEVIATION_PER_MEDIAN

FloatImage = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """What counts as still.

    Attributes
    ----------
    moved_blocks
        Largest part of the blocks that may differ from the mean so far: burnt-in clocks and dose counters change.
    least_frames
        Frames that an average needs at least.
    most_frames
        Frames after which an average is complete.
    """

    moved_blocks: float = field(default_factory=lambda: STILL_FRAMES.moved_blocks)
    least_frames: int = field(default_factory=lambda: STILL_FRAMES.least_frames)
    most_frames: int = field(default_factory=lambda: STILL_FRAMES.most_frames)


@dataclass(frozen=True, slots=True, eq=False)
class StillRun:
    """Consecutive frames in which nothing moved.

    Attributes
    ----------
    mean
        Shape (rows, columns).
    frames
        How many were averaged.
    frames_after
        How many came after them before the run was known to have ended: the one that differs, or none.
    """

    mean: FloatImage
    frames: int
    frames_after: int = 0


def moved_part(frame: FloatImage, reference: FloatImage) -> float:
    """Part of the blocks in which a frame differs from a mean of earlier ones by more than noise.

    Parameters
    ----------
    frame, reference
        Shape (rows, columns) each.
    """
    difference = frame - _gain(frame, reference) * reference
    steps = np.diff(difference, axis=1)
    np.abs(steps, out=steps)
    noise = DEVIATION_PER_MEDIAN * float(np.median(steps, overwrite_input=True)) / np.sqrt(2.0)
    del steps
    sampled = reference[:: STILL_FRAMES.sampled_px, :: STILL_FRAMES.sampled_px]
    low, high = np.percentile(sampled, [STILL_FRAMES.darkest_percentile, STILL_FRAMES.brightest_percentile])
    size = np.abs(_blocks(difference))
    # The median of the blocks estimates their noise, unless most of them moved: then the noise of their pixels does.
    usual = min(DEVIATION_PER_MEDIAN * float(np.median(size)), STILL_FRAMES.correlated * noise / STILL_FRAMES.block_px)
    return float(np.mean(size > STILL_FRAMES.noise_sigmas * usual + STILL_FRAMES.span * float(high - low)))


def _gain(frame: FloatImage, reference: FloatImage) -> np.float32:
    """Factor of the automatic exposure between two frames; 1 when there is nothing to compare."""
    step = STILL_FRAMES.sampled_px
    seen, before = frame[::step, ::step], reference[::step, ::step]
    bright = before > np.median(before)
    if not bright.any():
        return np.float32(1.0)
    return np.float32(np.median(seen[bright] / np.maximum(before[bright], 1e-6)))


def _blocks(image: FloatImage) -> FloatImage:
    rows, columns = (max(side // STILL_FRAMES.block_px, 1) for side in image.shape)
    return np.asarray(cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.float32)


def still_runs(frames: Iterable[FloatImage], limits: MotionLimits | None = None) -> Iterator[StillRun]:
    """Cut a sequence of frames where something moves, and average each piece.

    Yields
    ------
    StillRun
        Every piece, also those shorter than `least_frames`. One that reaches `most_frames` is yielded at once; frames
        that still show the same are then left out.
    """
    limits = limits or MotionLimits()
    total: NDArray[np.float64] = np.zeros((0, 0))
    count = 0
    for frame in frames:
        if count and _differs(frame, _mean(total, count), limits):
            if count < limits.most_frames:
                yield StillRun(_mean(total, count), count, frames_after=1)
            count = 0
        if count == limits.most_frames:
            continue
        if count:
            total += frame
        else:
            total = frame.astype(np.float64)
        count += 1
        if count == limits.most_frames:
            yield StillRun(_mean(total, count), count)
    if 0 < count < limits.most_frames:
        yield StillRun(_mean(total, count), count)


def _mean(total: NDArray[np.float64], count: int) -> FloatImage:
    """Rounded as it is divided: an image of double precision between them would be the largest of all."""
    return np.divide(total, count, out=np.empty(total.shape, np.float32), casting="same_kind")


def _differs(frame: FloatImage, mean: FloatImage, limits: MotionLimits) -> bool:
    return frame.shape != mean.shape or moved_part(frame, mean) > limits.moved_blocks


def last_still_run(frames: Iterable[FloatImage], limits: MotionLimits | None = None) -> StillRun | None:
    """The piece with which a sequence ends: what is seen last is what is there now.

    Returns
    -------
    StillRun | None
        Also a piece shorter than `least_frames`: an earlier and longer one may show what is no longer there. It has
        every frame since the last motion, however many `most_frames` are. None when there is no frame.
    """
    every = replace(limits or MotionLimits(), most_frames=sys.maxsize)
    last = deque(still_runs(frames, every), maxlen=1)
    return last.pop() if last else None
