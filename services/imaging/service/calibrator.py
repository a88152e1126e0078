"""Calibrates stored images on a thread of its own, the newest first, until none is left; also those of an earlier run.

What waits is written in the image index, not in memory: a process that was killed goes on where it was. Of the images
that wait only the newest is held in memory; when it is done, the newest that still waits is read from the store.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

from services.imaging.core.calibration import compile_core
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.ring_tracking import calibrate_next
from services.imaging.devices.c_arm_memory import CArmMemory
from services.imaging.devices.image_file import read_image
from services.imaging.devices.image_index import IndexedImage
from services.imaging.devices.image_store import ImageStore
from services.imaging.devices.received_image import ReceivedImage
from services.imaging.service.headers import angles_deg, polarity_of
from services.imaging.service.wire import Outcome, calibration_message
from shared.bus.port import Bus
from shared.errors import Accepted, ImageUnreadable
from shared.geometry.calibration import CArmCalibration
from shared.geometry.parts import RingPart
from shared.messages.base import decode, encode
from shared.messages.cases import CaseContext
from shared.messages.imaging import FrameHeader
from shared.messages.stored_images import SkipCode
from shared.runtime.impairments import is_lack_of_memory, nearly_out_of_memory
from shared.runtime.latest import LatestSlot
from shared.runtime.lifecycle import Runtime
from shared.threads import supervised_thread

# How long leaving may wait for this loop.
_WAIT_S: Final = 0.2
# Chosen: one crash may be chance; three of the same image are not.
_MOST_ATTEMPTS: Final = 3
# Chosen: soon for people who wait, and seldom for a log.
_DISK_AGAIN_S: Final = 1.0
_MEMORY_AGAIN_S: Final = 1.0
# What may impair the service here.
STORE: Final = "store"
_CALIBRATION, _INDEX = "calibration", "index"


@dataclass(frozen=True, slots=True)
class OpenCase:
    """The case that is open, or that none is, and its ring."""

    context: CaseContext
    ring: RingPart | None

    def is_of(self, header: FrameHeader) -> bool:
        """Whether an image belongs to the set-up as it is now."""
        return (header.case_id, header.case_revision) == (self.context.case_id, self.context.revision)


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One stored image that waits for its calibration."""

    header: FrameHeader
    image: ReceivedImage


class Calibrator:
    """Publishes the calibration of each image, or notes why there is none."""

    def __init__(self, bus: Bus, runtime: Runtime, store: ImageStore, memory: CArmMemory) -> None:
        self._runtime, self._store, self._memory = runtime, store, memory
        self._calibrations = bus.retained_publisher(runtime.keys.calibration)
        self._newest: LatestSlot[Shot] = LatestSlot()
        self._published = 0
        self._look_again_s = 0.0
        self._ended = threading.Event()
        self._case: OpenCase | None = None  # None until the gateway has announced a usable one, or that there is none

    @contextmanager
    def running(self) -> Iterator[None]:
        """Work for as long as the context lasts."""
        worker = supervised_thread("calibrate", self._work)
        worker.start()
        try:
            yield
        finally:
            self._ended.set()
            self._newest.close()
            worker.join(5.0)

    def open_case(self, case: OpenCase | None) -> None:
        """Note the open case; what waits for another one is not calibrated any more. Images wait while it is None."""
        self._case = case

    def submit(self, shot: Shot) -> None:
        """Calibrate an image that has just been stored before any other."""
        self._newest.put(shot)

    def _work(self) -> None:
        compile_core()
        while not self._ended.is_set():
            shot = self._newest.take(_WAIT_S)
            waiting = self._left_behind() if shot is None else None
            self._look_after_store()
            if shot is not None:
                header = shot.header
            elif waiting is not None:
                header = decode(FrameHeader, waiting.header)
            else:
                continue
            try:
                self._handle(header, shot, waiting)
            except OSError as error:  # of the disk, not of the image, which waits in the index until it can be read
                self._note_index(error)
                self._ended.wait(_DISK_AGAIN_S)
            except Exception as error:  # noqa: BLE001 - the border of a task: the next image must not suffer from this one
                self._note_fault(header, error)
            else:
                self._runtime.status.impair(_CALIBRATION, None)

    def _note_fault(self, header: FrameHeader, error: Exception) -> None:
        """The image is left out, unless it was the process's memory that failed: then it waits in the index as well."""
        if is_lack_of_memory(error):
            self._wait_for_memory(header, error)
            return
        self._runtime.log.exception("fault", sha256=header.sha256)
        sentence = f"image {header.sha256[:12]} brought a fault: {error}; take another image"
        self._runtime.status.impair(_CALIBRATION, sentence)
        self._skip(header, SkipCode.FAULT, f"it brought a fault ({error}); take another image")

    def _wait_for_memory(self, header: FrameHeader, error: Exception) -> None:
        """Until the process may have as much again as an image needs; it is degraded meanwhile."""
        self._runtime.log.error("image waits for memory", sha256=header.sha256, detail=str(error))
        sentence = f"image {header.sha256[:12]} waits for memory ({error}); raise the limit, or end what takes it"
        self._runtime.status.impair(_CALIBRATION, sentence)
        while not self._ended.wait(_MEMORY_AGAIN_S) and nearly_out_of_memory() is not None:
            pass
        self._runtime.status.impair(_CALIBRATION, None)

    def _look_after_store(self) -> None:
        """A store that took no image takes them again when what it would write can be written."""
        status, now_s = self._runtime.status, time.monotonic()
        if not status.is_impaired_by(STORE) or now_s < self._look_again_s:
            return
        self._look_again_s = now_s + _DISK_AGAIN_S
        if self._store.takes_images():
            status.impair(STORE, None)

    def _left_behind(self) -> IndexedImage | None:
        """The newest image that waits, as soon as it is known which case is open."""
        try:
            waiting = None if self._case is None else self._store.index.newest_pending()
        except OSError as error:
            self._note_index(error)
            return None
        self._runtime.status.impair(_INDEX, None)
        return waiting

    def _note_index(self, error: OSError) -> None:
        """A disk that does not take what is to be kept impairs the service until it does."""
        self._runtime.log.error("image index", detail=str(error))
        self._runtime.status.impair(_INDEX, f"{error.strerror or error}; see to the disk of the image store")

    def _handle(self, header: FrameHeader, shot: Shot | None, waiting: IndexedImage | None) -> None:
        case = self._case
        self._store.index.skip_overtaken_frames(
            header.sequence, SkipCode.SUPERSEDED, "a newer image came while this frame of a run waited"
        )
        if case is None or not self._store.index.is_pending(header.sequence):
            return
        if not case.is_of(header) or case.ring is None:
            now = f"case '{case.context.case_id}' revision {case.context.revision}" if case.context.case_id else "none"
            message = f"it was taken in case '{header.case_id}' revision {header.case_revision}; open is {now}"
            self._skip(header, SkipCode.SET_UP_CHANGED, message)
            return
        shot = shot or self._read_again(header, waiting)
        if shot is not None:
            self._calibrate(shot, case.ring)

    def _read_again(self, header: FrameHeader, waiting: IndexedImage | None) -> Shot | None:
        """An image from the store; one that ended the process again and again is left alone."""
        content = self._store.get(header.sha256)
        if content is None:
            self._skip(header, SkipCode.FILE_MISSING, "its file is gone from the image store; take another image")
            return None
        if waiting is not None and waiting.attempts >= _MOST_ATTEMPTS:
            message = f"imaging ended or lacked memory {waiting.attempts} times with it (limit {_MOST_ATTEMPTS})"
            self._skip(header, SkipCode.FAULT, f"{message}; take another image")
            return None
        self._store.index.note_attempt(header.sequence)
        try:
            return Shot(header, read_image(content, header.sha256).normalised(polarity_of(header)))
        except ImageUnreadable as error:
            self._skip(header, SkipCode.FAULT, f"it cannot be read any more ({error}); take another image")
            return None

    def _skip(self, header: FrameHeader, code: SkipCode, message: str) -> None:
        self._runtime.log.warning("image not calibrated", sha256=header.sha256, code=code, detail=message)
        try:
            self._store.index.skip(header.sequence, code, message)
        except OSError as error:
            self._runtime.log.error("image index", detail=str(error))  # noqa: TRY400 - expected: no trace

    def _calibrate(self, shot: Shot, ring: RingPart) -> None:
        header = shot.header
        nominal = NominalGeometry(header.nominal_source_to_detector_mm, header.nominal_pixel_mm, header.focal_spot_mm)
        before = self._memory.before(ring.sha256, angles_deg(header))
        outcome, elapsed_ms = _timed(lambda: calibrate_next(shot.image.pixels, ring, nominal, before))
        message = calibration_message(outcome, elapsed_ms, ring, header)
        content = encode(message)
        try:
            self._store.index.put_calibration(header.sequence, content)
        except OSError as error:  # it is published all the same, and calibrated again after a restart
            self._runtime.log.error("calibration not kept", sha256=header.sha256, detail=str(error))  # noqa: TRY400
        if header.sequence > self._published:  # the last value on the bus stays that of the newest image
            self._published = header.sequence
            self._calibrations.put(content)
        if isinstance(outcome, Accepted):
            self._remember(outcome.value, ring, header)
        self._runtime.log.info(
            "calibrated", sha256=header.sha256, verdict=message.verdict, reasons=[r.message for r in message.reasons]
        )

    def _remember(self, calibration: CArmCalibration, ring: RingPart, header: FrameHeader) -> None:
        """Keep a calibration for the next image; say it when the ring is not where it was."""
        try:
            notice = self._memory.after(ring.sha256, angles_deg(header), calibration)
        except OSError as error:
            notice = f"the C-arm's position was not kept: {error.strerror or error}; free the disk"
        if notice is not None:
            self._runtime.log.warning("ring", sha256=header.sha256, detail=notice)
            self._runtime.ready(notice)


def _timed(calibrate: Callable[[], Outcome]) -> tuple[Outcome, float]:
    """What came out, and how long it took in milliseconds."""
    started = time.perf_counter()
    outcome = calibrate()
    return outcome, 1e3 * (time.perf_counter() - started)
