"""Frames of a video: every one of a file, the newest of what is live.

A live source does not wait while frames are compared and images handed on. Its frames would wait in the buffers of
network, system and decoder, and what is read would fall further and further behind what is there. A thread of its own
grabs all of them, therefore, and keeps the newest.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from shared.runtime.latest import LatestSlot
from shared.threads import supervised_thread

Picture = NDArray[np.generic]


class Capture(Protocol):
    """What is used of `cv2.VideoCapture`."""

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        """Whether it can be read."""
        ...

    def read(self) -> tuple[bool, Picture | None]:
        """Wait for the next frame; False and no frame at the end, or when none comes in time."""
        ...

    def get(self, propId: int, /) -> float:
        """Read a property of the format."""
        ...

    def release(self) -> None:
        """Close it; nobody may be reading."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A frame as it is decoded.

    Attributes
    ----------
    picture
        Shape (rows, columns) or (rows, columns, 3).
    grabbed_at_s
        When it was there, on the monotonic clock.
    """

    picture: Picture
    grabbed_at_s: float


@dataclass(frozen=True, slots=True)
class GrabbedFrames:
    """Frames of one capture.

    Attributes
    ----------
    frames
        Ends with the capture.
    dropped
        How many were grabbed so far and replaced by a newer one before anybody took them.
    """

    frames: Iterator[Frame]
    dropped: Callable[[], int]


Grab = Callable[[Capture, threading.Event], AbstractContextManager[GrabbedFrames]]
"""Gives the frames of a capture until an event is set."""


@contextmanager
def every_frame(capture: Capture, ended: threading.Event) -> Iterator[GrabbedFrames]:
    """Read a file, which waits."""
    yield GrabbedFrames(_read(capture, ended), lambda: 0)


@contextmanager
def newest_frames(capture: Capture, ended: threading.Event) -> Iterator[GrabbedFrames]:
    """Read a live source as fast as it sends; whoever takes a frame gets the newest.

    When the context ends nobody reads the capture any more.
    """
    newest: LatestSlot[Frame] = LatestSlot()
    left = threading.Event()

    def grab() -> None:
        try:
            for frame in _read(capture, ended, left):
                newest.put(frame)
        finally:
            newest.close()

    thread = supervised_thread("video frames", grab)
    thread.start()
    try:
        yield GrabbedFrames(iter(newest.take, None), lambda: newest.replaced)
    finally:
        left.set()
        thread.join()


def _read(capture: Capture, *ends: threading.Event) -> Iterator[Frame]:
    while not any(end.is_set() for end in ends):
        there, picture = capture.read()
        if not there or picture is None:
            return
        yield Frame(np.asarray(picture), time.monotonic())
