"""`distalock align`: frames of running fluoroscopy in, how to turn the C-arm out, one JSON line per frame."""

import argparse
import hashlib
import os
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from distalock.arguments import EXIT_BAD_INPUT
from distalock.image_files import images_in, read_image_file
from distalock.locate import EXIT_ACCEPTED, EXIT_REJECTED, NominalOptions, read_parts
from services.imaging.core.ring_tracking import calibrate_next
from services.imaging.devices.received_image import Acquisition
from services.imaging.devices.video_images import grey_of
from services.registration.core.c_arm_advice import CArmAngles
from services.registration.core.guidance.tracking import (
    FrameEstimate,
    Origin,
    Track,
    begin_track,
    track_frame,
)
from services.registration.core.localise import Parts, localise
from services.registration.guidance_report import DisplayRotationMemory, FrameFacts, guidance_message
from shared.errors import ImageUnreadable, InputError, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.messages.base import encode
from shared.messages.guidance import Guidance
from shared.messages.imaging import ImageReference

_VIDEOS = frozenset({".avi", ".mkv", ".mov", ".mp4", ".webm"})
_MOST_MISSED = 3


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One frame of a run.

    Attributes
    ----------
    pixels
        As received, darker is denser, shape (rows, columns).
    sha256
        Of the file, or of a video frame's pixels.
    """

    pixels: NDArray[np.float32]
    sha256: str
    acquisition: Acquisition


def require_frames(places: Iterable[Path]) -> None:
    """Refuse a place without frames before any frame is followed; of each place only the first one is read.

    Raises
    ------
    ImageUnreadable
        As `frames_of`.
    """
    for place in places:
        next(frames_of([place]))


def frames_of(places: Iterable[Path]) -> Iterator[Frame]:
    """Frames of image files, folders of them (in the order of their names) and videos, one after another.

    Raises
    ------
    ImageUnreadable
        When a place is none of these, or cannot be read.
    """
    for place in places:
        if not place.exists():
            raise ImageUnreadable(f"{place}: there is no such file or folder (0 found, 1 needed); check its name")
        if place.is_dir():
            yield from _folder_frames(place)
        elif place.suffix.lower() in _VIDEOS:
            yield from _video_frames(place)
        else:
            yield _image_frame(place)


def _folder_frames(folder: Path) -> Iterator[Frame]:
    files = images_in(folder)
    if not files:
        raise ImageUnreadable(
            f"{folder}: holds no PNG, TIFF or DICOM files (0 found, 1 needed); name the frames' folder, or a video"
        )
    yield from map(_image_frame, files)


def _image_frame(file: Path) -> Frame:
    image = read_image_file(file)
    return Frame(image.content.pixels, image.sha256, image.content.acquisition)


def _video_frames(file: Path) -> Iterator[Frame]:
    # what FFmpeg says of a file that it cannot read would stand beside our one sentence
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    capture = cv2.VideoCapture(str(file))
    try:
        count = 0
        while True:
            there, picture = capture.read()
            if not there or picture is None:
                break
            count += 1
            pixels = grey_of(np.asarray(picture))
            yield Frame(pixels, hashlib.sha256(pixels.tobytes()).hexdigest(), Acquisition())
    finally:
        capture.release()
    if count == 0:
        raise ImageUnreadable(
            f"{file}: none of its {file.stat().st_size} bytes could be decoded as video (0 frames found, 1 needed); "
            "record it again, or give its frames as a folder of PNG files"
        )


class Guide:
    """Says of one frame after another how to turn the C-arm.

    A frame is localised in full when none before it could be, or when those just before it could not be followed.
    """

    def __init__(self, parts: Parts, nominal: NominalOptions) -> None:
        self._parts, self._nominal = parts, nominal
        self._display = DisplayRotationMemory()
        self._before: CArmCalibration | None = None
        self._track: Track | None = None
        self._count = 0

    def advice(self, frame: Frame) -> Guidance:
        """C-arm positioning advice from the next frame."""
        self._count += 1
        geometry, pixels = self._nominal.geometry(frame.acquisition), self._nominal.pixels(frame.pixels)
        outcome = calibrate_next(pixels, self._parts.ring, geometry, self._before)
        began_s = time.perf_counter()
        if isinstance(outcome, Rejected):
            estimate = FrameEstimate(Origin.FOLLOWED, None, None, outcome.reasons, None)
        else:
            self._before = outcome.value
            estimate = self._estimate(pixels, outcome.value)
        facts = FrameFacts(
            ImageReference(
                sha256=frame.sha256, sop_instance_uid="", sequence=self._count, received_at_ns=time.time_ns()
            ),
            None,
            0,
            _angles(frame.acquisition),
            None if isinstance(outcome, Rejected) else outcome.value,
            0,
            1e3 * (time.perf_counter() - began_s),
        )
        return guidance_message(estimate, facts, self._display)

    def _estimate(self, pixels: NDArray[np.float32], calibration: CArmCalibration) -> FrameEstimate:
        if self._track is not None and self._track.frames_without_estimate < _MOST_MISSED:
            estimate, self._track = track_frame(pixels, calibration, self._parts, self._track)
            return estimate
        found = localise(pixels, calibration, self._parts)
        estimate, track = begin_track(pixels, calibration, self._parts, found)
        self._track = track or self._track
        return estimate


def _angles(acquisition: Acquisition) -> CArmAngles | None:
    primary, secondary = acquisition.positioner_primary_angle_deg, acquisition.positioner_secondary_angle_deg
    return None if primary is None or secondary is None else CArmAngles(primary, secondary)


def run(given: argparse.Namespace) -> int:
    """Run `distalock align`; returns the exit code of the last frame: 0 with advice, 3 without, 2 bad input."""
    verdict = "rejected"
    try:
        parts = read_parts(given.ring, given.guide, given.nail)
        require_frames(given.images)
        guide = Guide(parts, NominalOptions.of(given))
        for frame in frames_of(given.images):
            advice = guide.advice(frame)
            verdict = advice.verdict
            print(encode(advice).decode(), flush=True)
    except InputError as error:
        print(f"distalock align: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    return EXIT_ACCEPTED if verdict == "accepted" else EXIT_REJECTED
