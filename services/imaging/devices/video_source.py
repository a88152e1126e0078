"""Images from a video signal: a frame grabber, a network stream or a file, by OpenCV.

Frames are averaged for as long as the picture stands still; what is handed on is one image per view, not one per frame.
"""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from services.imaging.core.still_frames import MotionLimits, StillRun, still_runs
from services.imaging.devices.source import Refused, Take
from shared.errors import ConfigurationError, ImageUnreadable
from shared.runtime.logging import Log
from shared.threads import supervised_thread

_STABLE_IDS = Path("/dev/v4l/by-id")
# Chosen: a source that gives nothing for this long is given up and opened anew.
_OPEN_MS, _READ_MS = 5000, 5000
_RETRY_S = 1.0
# Chosen: long enough for a frame rate within 1 %, short enough to see a source that slows down.
_RATE_EVERY_S = 10.0
_PNG_FAST = (cv2.IMWRITE_PNG_COMPRESSION, 1)


@dataclass(frozen=True, slots=True)
class Region:
    """The part of a frame that holds the X-ray image: left, top, width and height in pixels."""

    left: int
    top: int
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class VideoSettings:
    """Which video, and what of it.

    Attributes
    ----------
    address
        Part of a device's stable id (as in /dev/v4l/by-id), a device file, a file, or an rtsp, udp, tcp or http URL.
    region
        What to cut out; None takes the whole frame.
    least_frames
        Still frames that make an image.
    most_frames
        Still frames after which an image is complete.
    """

    address: str
    region: Region | None = None
    least_frames: int = 3
    most_frames: int = 8


class VideoSource:
    """Hands over an image when the picture has stood still, and the next one when the view has changed.

    A stream or a device that falls silent is opened again every second; a file ends.
    """

    def __init__(self, settings: VideoSettings, log: Log, ids: Path = _STABLE_IDS) -> None:
        self._settings = settings
        self._log = log
        self._ids = ids

    @contextmanager
    def receiving(self, take: Take) -> Iterator[str]:
        """Read frames for as long as the context lasts."""
        opened = self._open()
        ended = threading.Event()
        worker = supervised_thread("video", lambda: self._work(opened, take, ended))
        worker.start()
        try:
            yield described(opened, self._settings)
        finally:
            ended.set()
            worker.join(2e-3 * _READ_MS)

    def _open(self) -> cv2.VideoCapture:
        place = device_of(self._settings.address, self._ids)
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _OPEN_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, _READ_MS]
        if place.startswith("/dev/"):
            capture = cv2.VideoCapture(place, cv2.CAP_V4L2)
        else:
            capture = cv2.VideoCapture(place, cv2.CAP_FFMPEG, limits)
        if not capture.isOpened():
            capture.release()
            raise ConfigurationError(
                f"the video {self._settings.address} did not open within {_OPEN_MS / 1e3:g} s; check that it runs, "
                f"that no other program holds it, and its name ({_known(self._ids)})"
            )
        return capture

    def _work(self, capture: cv2.VideoCapture, take: Take, ended: threading.Event) -> None:
        reader: cv2.VideoCapture | None = capture
        while reader is not None and not ended.is_set():
            self._hand_on(_Frames(reader, self._settings, self._log, ended), take)
            reader.release()
            reader = None if Path(self._settings.address).is_file() else self._again(ended)
        if reader is not None:
            reader.release()

    def _again(self, ended: threading.Event) -> cv2.VideoCapture | None:
        """Open a source that fell silent, as often as it takes."""
        self._log.error("video fell silent; it is opened again every second", video=self._settings.address)
        while not ended.wait(_RETRY_S):
            try:
                return self._open()
            except ConfigurationError as error:
                self._log.warning("video not there", detail=str(error))
        return None

    def _hand_on(self, frames: "_Frames", take: Take) -> None:
        limits = MotionLimits(least_frames=self._settings.least_frames, most_frames=self._settings.most_frames)
        for run in still_runs(frames, limits):
            if run.frames >= limits.least_frames:
                self._give(run, take)

    def _give(self, run: StillRun, take: Take) -> None:
        sender = f"video {self._settings.address}"
        scale = 65535.0 / 255.0
        pixels = np.round(np.clip(scale * run.mean, 0.0, 65535.0)).astype(np.uint16)
        try:
            take(cv2.imencode(".png", pixels, _PNG_FAST)[1].tobytes(), sender)
        except ImageUnreadable as error:
            self._log.warning("image refused", sender=sender, detail=str(error))
        except (Refused, OSError) as error:
            self._log.error("image not taken", sender=sender, detail=str(error))


class _Frames:
    """Grey frames of a capture, cut to the region, with the measured rate in the log."""

    def __init__(self, capture: cv2.VideoCapture, settings: VideoSettings, log: Log, ended: threading.Event) -> None:
        self._capture, self._settings, self._log, self._ended = capture, settings, log, ended

    def __iter__(self) -> Iterator[NDArray[np.float32]]:
        started, count = time.monotonic(), 0
        while not self._ended.is_set():
            there, frame = self._capture.read()
            if not there or frame is None:
                return
            count += 1
            elapsed = time.monotonic() - started
            if elapsed > _RATE_EVERY_S:
                self._log.info("video", video=self._settings.address, frames_per_s=round(count / elapsed, 2))
                started, count = time.monotonic(), 0
            yield cut(grey_of(np.asarray(frame)), self._settings.region)


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


def device_of(address: str, ids: Path = _STABLE_IDS) -> str:
    """Device file whose stable id contains `address`, or the address itself.

    Raises
    ------
    ConfigurationError
        When more than one device fits.
    """
    if "://" in address or Path(address).exists() or not ids.is_dir():
        return address
    fitting = sorted(f.name for f in ids.iterdir() if address in f.name and f.name.endswith("index0"))
    if len(fitting) > 1:
        raise ConfigurationError(f"{len(fitting)} video devices fit '{address}' (1 needed): {', '.join(fitting)}")
    return str((ids / fitting[0]).resolve()) if fitting else address


def _known(ids: Path) -> str:
    names = sorted(f.name for f in ids.iterdir()) if ids.is_dir() else []
    return f"devices here: {', '.join(names)}" if names else "no video device is here"


def described(capture: cv2.VideoCapture, settings: VideoSettings) -> str:
    """The negotiated format, for people."""
    width, height = (round(capture.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    code = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
    name = code.to_bytes(4, "little").decode("ascii", "replace").strip("\0 ") or "raw"
    part = "" if settings.region is None else f", of which {settings.region.width} x {settings.region.height}"
    return f"video {settings.address}: {width} x {height} {name}, {capture.get(cv2.CAP_PROP_FPS):g} frames/s{part}"
