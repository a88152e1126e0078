"""Imaging: image in, frame and calibration out. No mathematics here."""

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from services.imaging.core.calibration import compile_core
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.ring_tracking import calibrate_next
from services.imaging.devices.c_arm_memory import CArmMemory
from services.imaging.devices.image_file import read_image
from services.imaging.devices.image_store import ImageStore
from services.imaging.devices.received_image import ReceivedImage
from services.imaging.devices.source import Refused
from services.imaging.service.headers import Arrival, Defaults, angles_deg, frame_header, polarity_of
from services.imaging.service.quality_handler import QualityHandler
from services.imaging.service.wire import Outcome, calibration_message, wire_pixels
from shared.bus.keys import Keys
from shared.bus.port import Answer, Bus, Query, Sample
from shared.errors import Accepted, BusError, ImageUnreadable, PartFileInvalid
from shared.geometry.calibration import CArmCalibration
from shared.geometry.parts import RingPart
from shared.messages.base import MessageInvalid, decode, encode
from shared.messages.cases import CaseContext
from shared.messages.imaging import FrameHeader
from shared.messages.qa import QaRequest
from shared.parts.files import ring_from_json
from shared.runtime.clock import Clock
from shared.runtime.latest import BoundedQueue
from shared.runtime.lifecycle import Runtime
from shared.threads import supervised_thread

_QUEUE = 64
_AGES_KEPT = 1024
_WAIT_S = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class _Shot:
    """One received image that waits for its calibration, with the ring of the case it joined."""

    header: FrameHeader
    image: ReceivedImage
    ring: RingPart | None


class ImagingService:
    """Keeps every image, publishes it as a frame, and calibrates it when a case with a ring is open.

    Parameters
    ----------
    bus, runtime
        Where to publish, and what the process gives every service.
    store
        Where images are kept.
    memory
        What is known of the C-arm from earlier images.
    quality
        Who makes quality reports.
    defaults
        Nominal C-arm values.
    run_interval_s
        Longest time between two images of a run (running fluoroscopy).
    clock
        When images are received, and how old they are.
    """

    def __init__(
        self,
        bus: Bus,
        runtime: Runtime,
        store: ImageStore,
        memory: CArmMemory,
        quality: QualityHandler,
        defaults: Defaults,
        run_interval_s: float,
        clock: Clock,
    ) -> None:
        self._runtime = runtime
        self._clock = clock
        self._received_at_s: OrderedDict[str, float] = OrderedDict()
        self._store = store
        self._defaults = defaults
        self._run_interval_s = run_interval_s
        self._bus = bus
        self._frames = bus.publisher(runtime.keys.frame)
        self._calibrations = bus.retained_publisher(runtime.keys.calibration)
        self._shots: BoundedQueue[_Shot] = BoundedQueue(_QUEUE)
        self._ended = threading.Event()
        self._lock = threading.Lock()
        self._case: CaseContext | None = None
        self._ring: RingPart | None = None
        self._newest: Arrival | None = None
        self._memory = memory
        self._quality = quality

    @contextmanager
    def running(self) -> Iterator[None]:
        """Listen and work for as long as the context lasts."""
        keys: Keys = self._runtime.keys
        case = self._bus.subscribe_retained(keys.case_context, self._on_case)
        frames = self._bus.queryable(keys.any_frame_by_hash, self._on_frame_query)
        reports = self._bus.queryable(keys.qa_request, self._on_qa_request)
        worker = supervised_thread("calibrate", self._work)
        worker.start()
        try:
            yield
        finally:
            case.close()
            frames.close()
            reports.close()
            self._ended.set()
            self._shots.close()
            worker.join(5.0)

    def take(self, content: bytes, sender: str) -> None:
        """Keep one image, publish it at once and queue it for calibration; called from the receiver's threads.

        Whoever wants to know where the robot stood when an image was made must hear of it before it is calibrated.

        Raises
        ------
        ImageUnreadable
            When it is not an image.
        Refused
            When too many images wait already.
        OSError
            When the disk does not take it.
        """
        received = self._clock.unix_ns(), self._clock.monotonic_s()
        image = read_image(content, sender).normalised(self._defaults.polarity)
        sha256 = self._store.put(image.dicom)
        with self._lock:
            arrival = Arrival.after(self._newest, self._runtime.boot_epoch, received, self._run_interval_s)
            self._newest = arrival
            header = frame_header(image, sha256, arrival, self._case, self._defaults)
            self._store.put_header(sha256, encode(header))
            self._note_receipt(sha256, arrival.received_at_s)
            queued = self._shots.put(_Shot(header, image, self._ring))
            if queued:
                self._announce(header, image)
        if not queued:
            raise Refused(f"{_QUEUE} images wait to be calibrated (limit {_QUEUE}); send this one again in a minute")
        self._runtime.log.info("image received", sender=sender, sha256=sha256, case=header.case_id)

    def _announce(self, header: FrameHeader, image: ReceivedImage) -> None:
        try:
            self._frames.put(wire_pixels(image), encode(self._with_age(header)))
        except BusError as error:
            self._runtime.log.exception("image not published", sha256=header.sha256)
            self._runtime.degraded(f"image {header.sha256[:12]} could not be published: {error}; take another image")

    def _note_receipt(self, sha256: str, received_at_s: float) -> None:
        self._received_at_s[sha256] = received_at_s
        self._received_at_s.move_to_end(sha256)
        while len(self._received_at_s) > _AGES_KEPT:
            self._received_at_s.popitem(last=False)

    def _with_age(self, header: FrameHeader) -> FrameHeader:
        """The header as it is published now; of an image from before this run of imaging nobody knows the age."""
        received_at_s = self._received_at_s.get(header.sha256)
        age_s = None if received_at_s is None else max(self._clock.monotonic_s() - received_at_s, 0.0)
        return header.model_copy(update={"age_s": age_s})

    def _on_case(self, sample: Sample) -> None:
        try:
            case = decode(CaseContext, sample.payload)
            ring = ring_from_json(case.ring_json.encode(), "ring of the open case") if case.ring_json else None
        except (MessageInvalid, PartFileInvalid) as error:
            self._runtime.log.error("case context refused", detail=str(error))  # noqa: TRY400 - expected: no trace
            self._runtime.degraded(f"the open case cannot be used: {error}; correct the ring's file")
            return
        with self._lock:
            self._case, self._ring = case, ring
        self._runtime.ready()

    def _on_frame_query(self, query: Query) -> Answer:
        """Pixels and header of a kept image, by its hash."""
        sha256 = query.key.rsplit("/", 1)[-1]
        content, kept = self._store.get(sha256), self._store.get_header(sha256)
        if content is None or kept is None:
            raise ImageUnreadable(f"no image with SHA-256 {sha256} is kept here (0 found, 1 needed); send it again")
        header = decode(FrameHeader, kept)
        image = read_image(content, sha256).normalised(polarity_of(header))
        return Answer(wire_pixels(image), encode(self._with_age(header)))

    def _on_qa_request(self, query: Query) -> Answer:
        """A quality report over kept images; the bus answers each key on a thread of its own."""
        request = decode(QaRequest, query.payload)
        with self._lock:
            case, ring = self._case, self._ring
        there = case is not None and case.case_id == request.case_id
        reply = self._quality.reply(request, ring if there else None)
        self._runtime.log.info("quality report", verdict=reply.report and reply.report.verdict, code=reply.code)
        return Answer(encode(reply))

    def _work(self) -> None:
        """Calibrate what is queued, in order of arrival; an image of a run is skipped when a newer one waits."""
        compile_core()
        while not self._ended.is_set():
            shot = self._shots.take(_WAIT_S)
            if shot is None or (shot.header.run_interval_s is not None and len(self._shots) > 0):
                continue
            try:
                self._calibrate(shot)
            except Exception as error:  # the border of a task: the next image must not suffer from this one
                self._runtime.log.exception("fault", sha256=shot.header.sha256)
                self._runtime.degraded(f"image {shot.header.sha256[:12]} brought a fault: {error}; take another image")

    def _calibrate(self, shot: _Shot) -> None:
        if shot.header.case_id is None or shot.ring is None:
            self._runtime.log.info("image kept, not calibrated: no case with a ring is open", sha256=shot.header.sha256)
            return
        header, ring = shot.header, shot.ring
        nominal = NominalGeometry(header.nominal_source_to_detector_mm, header.nominal_pixel_mm, header.focal_spot_mm)
        before = self._memory.before(ring.sha256, angles_deg(header))
        outcome, elapsed_ms = _timed(lambda: calibrate_next(shot.image.pixels, ring, nominal, before))
        message = calibration_message(outcome, elapsed_ms, ring, header)
        self._calibrations.put(encode(message))
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
