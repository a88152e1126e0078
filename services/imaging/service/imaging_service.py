"""Imaging: image in, frame and calibration out. No mathematics here."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from services.imaging.devices.image_file import read_image
from services.imaging.devices.image_index import IndexedImage
from services.imaging.devices.image_store import ImageStore
from services.imaging.devices.received_image import ReceivedImage
from services.imaging.service.calibrator import STORE, Calibrator, OpenCase, Shot
from services.imaging.service.headers import Arrival, Defaults, ImageNumber, Moment, frame_header, polarity_of
from services.imaging.service.quality_handler import QualityHandler
from services.imaging.service.receipts import Receipts
from services.imaging.service.wire import wire_pixels
from shared.bus.keys import Keys
from shared.bus.port import Answer, Bus, Query, Sample
from shared.errors import BusError, ImageUnreadable, PartFileInvalid
from shared.messages.base import MessageInvalid, decode, encode
from shared.messages.cases import CaseContext
from shared.messages.imaging import FrameHeader
from shared.messages.qa import QaRequest
from shared.messages.stored_images import (
    Skip,
    SkipCode,
    Step,
    StoredImage,
    StoredImagesReply,
    StoredImagesRequest,
)
from shared.parts.files import ring_from_json, sha256_of
from shared.runtime.clock import Clock
from shared.runtime.lifecycle import Runtime

_NO_CASE = "no case with a ring was open when it was received"


class ImagingService:
    """Keeps every image, publishes it as a frame, and calibrates it when a case with a ring is open.

    Parameters
    ----------
    bus, runtime
        Where to publish, and what the process gives every service.
    store
        Where images are kept.
    calibrator
        Who calibrates them.
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
        calibrator: Calibrator,
        quality: QualityHandler,
        defaults: Defaults,
        run_interval_s: float,
        clock: Clock,
    ) -> None:
        self._runtime = runtime
        self._clock = clock
        self._receipts = Receipts(store)
        self._store = store
        self._defaults = defaults
        self._run_interval_s = run_interval_s
        self._bus = bus
        self._frames = bus.publisher(runtime.keys.frame)
        self._lock = threading.Lock()
        self._case: OpenCase | None = None
        self._case_known = threading.Event()
        self._newest: Arrival | None = None
        self._calibrator = calibrator
        self._quality = quality

    @contextmanager
    def running(self) -> Iterator[None]:
        """Listen and work for as long as the context lasts."""
        keys: Keys = self._runtime.keys
        with ExitStack() as stack:
            stack.enter_context(self._calibrator.running())
            for declared in (
                self._bus.subscribe_retained(keys.case_context, self._on_case),
                self._bus.queryable(keys.any_frame_by_hash, self._on_frame_query),
                self._bus.queryable(keys.any_calibration_of, self._on_calibration_query),
                self._bus.queryable(keys.stored_images, self._on_stored_images),
                self._bus.queryable(keys.qa_request, self._on_qa_request),
            ):
                stack.callback(declared.close)
            yield

    def wait_for_case(self, timeout_s: float) -> None:
        """Wait until it is known which case is open, so that the first image after a restart joins it."""
        self._case_known.wait(timeout_s)

    def take(self, content: bytes, sender: str, waited_s: float | None = 0.0, /) -> None:
        """Keep one image under the next number and publish it; called from the receiver's threads.

        It has waited at its source for `waited_s`: so much older it is, and of unknown age when that is None.

        When it returns, the image may be acknowledged: file and number are on the disk, and whatever is killed now,
        whoever missed the image will ask for it. It is published before it is calibrated: whoever wants to know where
        the robot stood when it was made must hear of it at once.

        Raises
        ------
        ImageUnreadable
            When it is not an image.
        OSError
            When the disk does not take it.
        """
        received = self._clock.unix_ns(), self._clock.monotonic_s()
        image = read_image(content, sender).normalised(self._defaults.polarity)
        sha256, uid = sha256_of(image.dicom), image.sop_instance_uid
        with self._store_watched():
            if self._receipts.note(sha256, uid, None if waited_s is None else received[1] - waited_s):
                self._runtime.log.warning("another file came with this UID: it is as old", sha256=sha256, uid=uid)
            self._store.put(image.dicom)
            with self._lock:
                header = self._numbered(image, sha256, received)
                self._announce(header, image)
                if header.case_id is not None:
                    self._calibrator.submit(Shot(header, image))
        self._runtime.log.info(
            "image received", sender=sender, sha256=sha256, sequence=header.sequence, case=header.case_id
        )

    @contextmanager
    def _store_watched(self) -> Iterator[None]:
        """A disk that takes no image impairs the service until it takes one, or would take one."""
        try:
            yield
        except OSError as error:
            why = f"the last image could not be stored ({error.strerror or error}); see to the disk and send it again"
            self._runtime.status.impair(STORE, why)
            raise
        self._runtime.status.impair(STORE, None)

    def _numbered(self, image: ReceivedImage, sha256: str, received: Moment) -> FrameHeader:
        """Give an image its number and its header, on the disk; the caller holds the lock."""
        index, case = self._store.index, self._case
        sequence = index.newest_sequence() + 1
        number = ImageNumber(index.store_id, sequence, self._runtime.boot_epoch)
        arrival = Arrival.after(self._newest, number, received, self._run_interval_s)
        context = None if case is None else case.context
        header = frame_header(image, sha256, arrival, context, self._defaults)
        index.add(sequence, sha256, encode(header), in_run=header.run_interval_s is not None)
        if case is None or header.case_id is None or case.ring is None:
            index.skip(sequence, SkipCode.NO_CASE, _NO_CASE)
        self._newest = arrival
        return header

    def _announce(self, header: FrameHeader, image: ReceivedImage) -> None:
        try:
            self._frames.put(wire_pixels(image), encode(self._with_age(header)))
        except BusError:  # whoever misses it asks for it
            self._runtime.log.exception("image not published", sha256=header.sha256)

    def _with_age(self, header: FrameHeader) -> FrameHeader:
        """The header as it is published now."""
        return self._receipts.with_age(header, self._clock.monotonic_s())

    def _on_case(self, sample: Sample) -> None:
        try:
            case = decode(CaseContext, sample.payload)
            ring = ring_from_json(case.ring_json.encode(), "ring of the open case") if case.ring_json else None
        except (MessageInvalid, PartFileInvalid) as error:
            self._runtime.log.error("case context refused", detail=str(error))  # noqa: TRY400 - expected: no trace
            self._enter(None)  # images that come now are not of the case before
            self._runtime.degraded(f"the open case cannot be used: {error}; correct the ring's file")
            return
        self._enter(OpenCase(case, ring))
        self._runtime.ready()

    def _enter(self, case: OpenCase | None) -> None:
        """Note the open case, or that the one that is open cannot be used."""
        with self._lock:
            self._case = case
        self._calibrator.open_case(case)
        self._case_known.set()

    def _on_frame_query(self, query: Query) -> Answer:
        """Pixels and header of a kept image, by its hash."""
        sha256 = query.key.rsplit("/", 1)[-1]
        content, kept = self._store.get(sha256), self._store.get_header(sha256)
        if content is None or kept is None:
            raise ImageUnreadable(f"no image with SHA-256 {sha256} is kept here (0 found, 1 needed); send it again")
        header = decode(FrameHeader, kept)
        image = read_image(content, sha256).normalised(polarity_of(header))
        return Answer(wire_pixels(image), encode(self._with_age(header)))

    def _on_calibration_query(self, query: Query) -> Answer:
        """A kept calibration, by its image's number."""
        number = query.key.rsplit("/", 1)[-1]
        content = self._store.index.calibration(int(number)) if number.isdecimal() else None
        if content is None:
            raise ImageUnreadable(f"image number {number} has no calibration here (0 found, 1 needed)")
        return Answer(content)

    def _on_stored_images(self, query: Query) -> Answer:
        """Headers after a number, and what became of the images."""
        request = decode(StoredImagesRequest, query.payload)
        index = self._store.index
        images = tuple(self._stored(one) for one in index.after(request.after, request.most))
        return Answer(encode(StoredImagesReply(store_id=index.store_id, newest=index.newest_sequence(), images=images)))

    def _stored(self, one: IndexedImage) -> StoredImage:
        skip = Skip(step=Step.CALIBRATION, code=SkipCode(one.code), message=one.message) if one.code else None
        header = self._with_age(decode(FrameHeader, one.header))
        return StoredImage.model_validate({"header": header, "calibration": one.state, "skip": skip})

    def _on_qa_request(self, query: Query) -> Answer:
        """A quality report over kept images; the bus answers each key on a thread of its own."""
        request = decode(QaRequest, query.payload)
        with self._lock:
            case = self._case
        there = case is not None and case.context.case_id == request.case_id
        reply = self._quality.reply(request, case.ring if case is not None and there else None)
        self._runtime.log.info("quality report", verdict=reply.report and reply.report.verdict, code=reply.code)
        return Answer(encode(reply))
