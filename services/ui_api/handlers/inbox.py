"""What comes in from the bus, put into the record by one thread, in the order in which it came.

Of a running fluoroscopy every frame is named in the record, but only the calibrations of its newest frames and of those
that were localised are kept there: each is a hundred times as long as the frame's header, and seldom read.
"""

import base64
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import (
    ImageCalibrated,
    ImageReceived,
    ImageSkipped,
    LocalisationReceived,
    PresenceChanged,
)
from services.ui_api.core.events import EventData, EventDraft
from services.ui_api.core.fluoroscopy import FluoroscopyRun
from services.ui_api.core.image_numbers import NumbersOnRecord
from services.ui_api.handlers.arrived_frames import ArrivedFrames
from services.ui_api.handlers.bus_refusals import BusRefusalLog
from services.ui_api.handlers.catch_up import CatchUp, Recorder
from services.ui_api.handlers.commands import CommandHandler
from services.ui_api.handlers.images import FRAME_TIMEOUT_S
from services.ui_api.handlers.robot_view import RobotView, change_of
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import UnitOfWork
from shared.bus.keys import Keys
from shared.bus.port import Bus, Sample
from shared.errors import NoReply, RecordUnavailable
from shared.messages.base import MessageInvalid, decode, encode
from shared.messages.imaging import CalibrationMessage, FrameHeader, ImageReference
from shared.messages.presence import ServiceName
from shared.messages.refusals import BusRefusals
from shared.messages.registration import LocalisationRecord
from shared.messages.robot import RobotState
from shared.messages.stored_images import Skip, Step, StoredImage
from shared.runtime.latest import BoundedQueue
from shared.runtime.logging import Log
from shared.threads import report_error, supervised_thread

WATCHED_SERVICES: tuple[ServiceName, ...] = ("imaging", "registration", "robot")
# Chosen: a bound on memory; images beyond it are asked for again by their numbers.
_QUEUE_SIZE = 4096
# How long the thread waits for work before any run of images: nothing depends on it.
_IDLE_S = 0.5
_AGAIN_AFTER_S = 0.25
_WHO_SKIPS = {Step.CALIBRATION: "imaging", Step.LOCALISATION: "registration"}


@dataclass(slots=True)
class ServicePresence:
    """Which services hold their liveliness token now, and which image source was heard of last."""

    alive: dict[ServiceName, bool]
    image_source: str = ""


class Inbox:
    """Subscribes and records from `start` on; its thread ends on `close` once everything that came in is recorded.

    Attributes
    ----------
    blocked
        Why the record takes nothing at the moment, or None.
    """

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        record: CaseRecord,
        view: RobotView,
        commands: CommandHandler,
        refusals: BusRefusalLog,
        log: Log,
        run_calibrations: int,
    ) -> None:
        self._refusals = refusals
        self._bus, self._keys, self._record = bus, keys, record
        self._view, self._commands, self._log = view, commands, log
        self._queue: BoundedQueue[Callable[[], None]] = BoundedQueue(_QUEUE_SIZE)
        self._frames = ArrivedFrames(_QUEUE_SIZE, log)
        self._run: FluoroscopyRun[bytes] = FluoroscopyRun(run_calibrations)
        self._run_interval_s = _IDLE_S
        self._ended = False
        self._robot_is_missed = False  # its newest condition found no place in the queue
        self._closing = threading.Event()
        self.blocked: str | None = None
        self._thread = supervised_thread("inbox", self._work)
        self.presence = ServicePresence(dict.fromkeys(WATCHED_SERVICES, False))
        recorder = Recorder(
            self._images, self._record_whole, self._record_localisation, self._skip, self._put_if_possible
        )
        self._catch_up = CatchUp(bus, keys, record, recorder, log)

    def start(self) -> None:
        """Begin to listen and to record."""
        self._thread.start()
        self.listen()
        self._catch_up.start()

    def listen(self) -> None:
        """Subscribe, as `start` does; what is to be recorded waits for `next_work`."""
        self._bus.subscribe_attachments(self._keys.frame, self._frame_later)
        for key, handle in ((self._keys.calibration, self._calibration), (self._keys.localisation, self._localisation)):
            self._bus.subscribe_retained(key, self._recorded_later(handle))
        self._bus.subscribe_retained(self._keys.robot_state, self._robot_state)
        self._bus.subscribe(self._keys.bus_refusals, self._recorded_later(self._refused_on_bus))
        for service in WATCHED_SERVICES:
            self._bus.presence().watch_alive(self._keys.alive(service), self._presence_of(service))

    def next_work(self, timeout_s: float) -> Callable[[], None] | None:
        """Wait up to `timeout_s` for the next of what is to be recorded; None when nothing came."""
        return self._queue.take(timeout_s)

    def close(self) -> None:
        """Record what is still waiting, then end."""
        self._catch_up.close()
        self._closing.set()
        self._put(self._end)
        if self._thread.is_alive():
            self._thread.join(5.0)

    @property
    def waiting(self) -> int:
        """How many pieces of work wait to be recorded."""
        return len(self._queue)

    @property
    def refused(self) -> int:
        """How many pieces of work found no place."""
        return self._queue.refused

    def _put(self, work: Callable[[], None]) -> None:
        self._put_if_possible(work)

    def _put_if_possible(self, work: Callable[[], None]) -> bool:
        taken = self._queue.put(work)
        if not taken:
            self._log.error("inbox_full", refused=self._queue.refused, size=_QUEUE_SIZE)
        return taken

    def _work(self) -> None:
        while not self._ended:
            work = self.next_work(self._run_interval_s) or self._run_ended
            try:
                self._recorded(work)
            except MessageInvalid as error:
                self._log.error("message_invalid", detail=str(error))
            except Exception as error:  # noqa: BLE001 - the border of a task: one message must not end the recording
                report_error("the inbox", error)

    def _recorded(self, work: Callable[[], None]) -> None:
        """Do one piece of work, again and again while the record takes nothing: what came in is not lost by that."""
        while True:
            try:
                work()
            except RecordUnavailable as error:
                self.blocked = str(error)
                if self._closing.wait(_AGAIN_AFTER_S):
                    raise
            else:
                self.blocked = None
                return

    def _end(self) -> None:
        self._ended = True
        self._run_ended()
        self._queue.close()

    def _run_ended(self) -> None:
        """Record what is left of a run of fluoroscopy: its newest frames."""
        for payload in self._run.end(time.monotonic()):
            self._record_calibration(decode(CalibrationMessage, payload), payload)

    def _frame_later(self, attachment: bytes) -> None:
        self._frames.put(attachment)
        self._put(self._record_frames)

    def _recorded_later(self, handle: Callable[[bytes], None]) -> Callable[[Sample], None]:
        return lambda sample: self._put(lambda: handle(sample.payload))

    def _robot_state(self, sample: Sample) -> None:
        """On the bus's thread, so that the newest state never waits for the record."""
        state = decode(RobotState, sample.payload)
        changed = self._view.note(state) or self._robot_is_missed
        if changed:  # where the queue is full, with the next state that finds a place
            self._robot_is_missed = not self._put_if_possible(lambda: self._robot_changed(state))
        if changed or self._record.ledger.pending_operations():
            self._put(lambda: self._commands.follow(state))

    def _robot_changed(self, state: RobotState) -> None:
        self._append_to_open_case(change_of(state), "robot")

    def _refused_on_bus(self, payload: bytes) -> None:
        event = self._refusals.note(decode(BusRefusals, payload))
        if event is not None:
            self._append_to_open_case(event, "router")

    def _presence_of(self, service: ServiceName) -> Callable[[str, bool], None]:
        def changed(_: str, alive: bool) -> None:  # noqa: FBT001 - the bus port's signature
            if self.presence.alive[service] is not alive:
                self.presence.alive[service] = alive
                self._put(lambda: self._append_to_open_case(PresenceChanged(service, alive), service))
                if alive:
                    self._catch_up.wake()

        return changed

    def _append_to_open_case(self, data: EventData, who: str) -> None:
        with self._record.write() as unit:
            case = self._record.ledger.open_case()
            unit.append(EventDraft(data, case.case_id if case else None, who))

    def _record_frames(self) -> None:
        """Record all frames that have come, in one transaction; a record that takes nothing leaves them waiting.

        Whoever acts writes first: of thirty frames a second those of a moment are recorded together.
        """
        self._commands.acting.wait_until_nobody()
        count, headers = self._frames.waiting()
        if headers:
            newest = headers[-1]
            self.presence.image_source = f"{newest.manufacturer} {newest.model_name}".strip()
            with self._record.write() as unit:
                for header in headers:
                    self._keep_image(unit, header.case_id, header.case_revision, header.reference(), header)
            if newest.sequence > self._numbers(newest.store_id).through:
                self._catch_up.wake()
        self._frames.recorded(count)

    def _images(self, images: tuple[StoredImage, ...]) -> None:
        """Images that were missed, in the order of their numbers."""
        with self._record.write() as unit:
            for header in (one.header for one in images):
                if header.sequence not in self._numbers(header.store_id):
                    self._keep_image(unit, header.case_id, header.case_revision, header.reference(), header)

    def _skip(self, case: Case, image: ImageReceived, skip: Skip) -> None:
        with self._record.write() as unit:
            if self._record.ledger.cases[case.case_id].skip_of(image.image_sha256) is None:
                data = ImageSkipped(image.image_sha256, skip.step.value, skip.code.value, skip.message)
                unit.append(EventDraft(data, case.case_id, _WHO_SKIPS[skip.step]))

    def _numbers(self, store_id: str | None) -> NumbersOnRecord:
        return self._record.ledger.images.get(store_id or "", NumbersOnRecord())

    def _calibration(self, payload: bytes) -> None:
        message = decode(CalibrationMessage, payload)
        run_interval_s = message.image.run_interval_s
        if run_interval_s is None:
            self._run_ended()
            self._record_calibration(message, payload)
        elif self._run.was_awaited(message.image.sha256):  # its localisation arrived before its calibration
            self._record_calibration(message, payload)
        else:
            self._run_interval_s = run_interval_s
            self._run.hold(message.image.sha256, payload)

    def _record_whole(self, payload: bytes) -> None:
        self._record_calibration(decode(CalibrationMessage, payload), payload)

    def _record_calibration(self, message: CalibrationMessage, payload: bytes) -> None:
        codes = tuple(reason.code.value for reason in message.reasons)
        header = self._header_if_missed(message.case_id, message.image)
        with self._record.write() as unit:
            case = self._record.ledger.cases.get(message.case_id or "")
            document = unit.put_document(payload)
            data = ImageCalibrated(message.image.sha256, message.verdict, codes, document)
            if case is None or data in case.calibrations:
                return
            self._keep_image(unit, message.case_id, message.case_revision, message.image, header)
            unit.append(EventDraft(data, case.case_id, "imaging"))

    def _localisation(self, payload: bytes) -> None:
        self._record_localisation(decode(LocalisationRecord, payload))

    def _record_localisation(self, message: LocalisationRecord) -> None:
        held = self._run.claim(message.image.sha256)
        if held is not None:
            self._record_calibration(decode(CalibrationMessage, held), held)
        found = message.localisation
        header = self._header_if_missed(message.case_id, message.image)
        with self._record.write() as unit:
            case = self._record.ledger.cases.get(message.case_id)
            if case is None or case.knows_localisation(message.image.sha256, message.registration_epoch):
                return
            self._keep_image(unit, message.case_id, message.case_revision, message.image, header)
            data = LocalisationReceived(
                number=len(case.localisations) + 1,
                image_sha256=message.image.sha256,
                case_revision=message.case_revision,
                registration_epoch=message.registration_epoch,
                verdict=found.verdict,
                reason_codes=tuple(reason.code.value for reason in found.reasons),
                document_sha256=unit.put_document(encode(message.model_copy(update={"overlay_png_base64": None}))),
                overlay_sha256=_keep_overlay(unit, message),
            )
            unit.append(EventDraft(data, case.case_id, "registration"))

    def _header_if_missed(self, case_id: str | None, reference: ImageReference) -> FrameHeader | None:
        """Frames may be dropped on the bus: then a result is the first to tell, and imaging is asked for the header."""
        case = self._record.ledger.cases.get(case_id or "")
        if case is None or _has_image(case, reference):
            return None
        try:
            answer = self._bus.query(self._keys.frame_by_hash(reference.sha256), b"", FRAME_TIMEOUT_S)
            return decode(FrameHeader, answer.attachment)
        except (NoReply, MessageInvalid) as error:
            self._log.warning("header_missing", image=reference.sha256, detail=str(error))
            return None

    def _keep_image(
        self,
        unit: UnitOfWork,
        case_id: str | None,
        revision: int,
        reference: ImageReference,
        header: FrameHeader | None,
    ) -> None:
        """Record an image once."""
        case = self._record.ledger.cases.get(case_id or "")
        if reference.store_id is not None and reference.sequence in self._numbers(reference.store_id):
            return
        if case is not None and _has_image(case, reference):
            return
        header_sha256 = None if header is None else unit.put_document(encode(header))
        data = ImageReceived(
            reference.sha256,
            reference.sop_instance_uid,
            reference.received_at_ns,
            revision,
            header_sha256,
            reference.store_id,
            None if reference.store_id is None else reference.sequence,
            reference.run_interval_s is not None,
            None if header is None else header.laterality,
        )
        unit.append(EventDraft(data, case.case_id if case else None, "imaging"))


def _has_image(case: Case, reference: ImageReference) -> bool:
    """By its number; in messages and records of older versions by hash and time."""
    if reference.store_id is not None:
        wanted = (reference.store_id, reference.sequence)
        return any((i.store_id, i.sequence) == wanted for i in reversed(case.images))
    return any((i.image_sha256, i.received_at_ns) == (reference.sha256, reference.received_at_ns) for i in case.images)


def _keep_overlay(unit: UnitOfWork, message: LocalisationRecord) -> str | None:
    if message.overlay_png_base64 is None:
        return None
    return unit.put_document(base64.b64decode(message.overlay_png_base64, validate=True), "image/png")
