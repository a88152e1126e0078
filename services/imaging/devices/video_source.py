"""Images from a video signal: a frame grabber, a network stream or a file, by OpenCV.

Frames are averaged for as long as the picture stands still; what is handed on is one image per view, not one per frame.
Of what is live the newest frame counts (`video_frames`); a file is read frame by frame.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from services.imaging.core.still_frames import MotionLimits
from services.imaging.devices.source import Refused, Take
from services.imaging.devices.video_frames import Capture, Grab, GrabbedFrames, every_frame, newest_frames
from services.imaging.devices.video_images import Region, VideoImage, VideoImages
from shared.errors import ConfigurationError, ImageUnreadable
from shared.runtime.logging import Log
from shared.threads import supervised_thread

_STABLE_IDS = Path("/dev/v4l/by-id")
# Chosen: a source that gives nothing for this long is given up and opened anew.
_OPEN_MS, _READ_MS = 5000, 5000
_RETRY_S = 1.0
_PNG_FAST = (cv2.IMWRITE_PNG_COMPRESSION, 1)


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

    def __init__(
        self,
        settings: VideoSettings,
        log: Log,
        ids: Path = _STABLE_IDS,
        opened: Callable[[str], Capture] | None = None,
    ) -> None:
        self._settings = settings
        self._log = log
        self._ids = ids
        self._opened = opened or opened_capture

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

    def _open(self) -> Capture:
        capture = self._opened(device_of(self._settings.address, self._ids))
        if not capture.isOpened():
            capture.release()
            raise ConfigurationError(
                f"the video {self._settings.address} did not open within {_OPEN_MS / 1e3:g} s; check that it runs, "
                f"that no other program holds it, and its name ({_known(self._ids)})"
            )
        return capture

    def _work(self, capture: Capture, take: Take, ended: threading.Event) -> None:
        is_file = Path(self._settings.address).is_file()
        grab: Grab = every_frame if is_file else newest_frames
        reader: Capture | None = capture
        while reader is not None and not ended.is_set():
            with grab(reader, ended) as grabbed:
                self._hand_on(grabbed, take)
            reader.release()
            reader = None if is_file else self._again(ended)
        if reader is not None:
            reader.release()

    def _again(self, ended: threading.Event) -> Capture | None:
        """Open a source that fell silent, as often as it takes."""
        self._log.error("video fell silent; it is opened again every second", video=self._settings.address)
        while not ended.wait(_RETRY_S):
            try:
                return self._open()
            except ConfigurationError as error:
                self._log.warning("video not there", detail=str(error))
        return None

    def _hand_on(self, grabbed: GrabbedFrames, take: Take) -> None:
        limits = MotionLimits(least_frames=self._settings.least_frames, most_frames=self._settings.most_frames)
        images = VideoImages(grabbed, self._settings.region, self._settings.address, self._log)
        for image in images.averaged(limits):
            self._give(image, take)

    def _give(self, image: VideoImage, take: Take) -> None:
        sender = f"video {self._settings.address}"
        scale = 65535.0 / 255.0
        pixels = np.round(np.clip(scale * image.mean, 0.0, 65535.0)).astype(np.uint16)
        try:
            content = cv2.imencode(".png", pixels, _PNG_FAST)[1].tobytes()
            take(content, sender, time.monotonic() - image.grabbed_at_s)
        except ImageUnreadable as error:
            self._log.warning("image refused", sender=sender, detail=str(error))
        except (Refused, OSError) as error:
            self._log.error("image not taken", sender=sender, detail=str(error))


def opened_capture(place: str) -> cv2.VideoCapture:
    """Open a device, file or URL with OpenCV, in a bounded time."""
    if place.startswith("/dev/"):
        return cv2.VideoCapture(place, cv2.CAP_V4L2)
    limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _OPEN_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, _READ_MS]
    return cv2.VideoCapture(place, cv2.CAP_FFMPEG, limits)


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


def described(capture: Capture, settings: VideoSettings) -> str:
    """The negotiated format, for people."""
    width, height = (round(capture.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    code = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
    name = code.to_bytes(4, "little").decode("ascii", "replace").strip("\0 ") or "raw"
    part = "" if settings.region is None else f", of which {settings.region.width} x {settings.region.height}"
    return f"video {settings.address}: {width} x {height} {name}, {capture.get(cv2.CAP_PROP_FPS):g} frames/s{part}"
