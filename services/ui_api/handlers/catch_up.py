"""Asks for what the gateway missed: images that imaging stored, their calibrations and localisations, or why not.

The bus drops frames and keeps one result for late joiners, and any process may be killed at any time. But imaging
numbers what it stores before it acknowledges it, so a gap shows. This thread asks until none is left: at the start,
when a service is back, when a gap shows, and every two seconds. What it gets is recorded by the inbox, in its turn.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import ImageReceived
from services.ui_api.core.image_numbers import NumbersOnRecord, unfinished
from services.ui_api.record.record import CaseRecord
from shared.bus.keys import Keys
from shared.bus.port import Bus
from shared.errors import DistalockError
from shared.messages.base import decode, encode
from shared.messages.imaging import CalibrationMessage, ImageReference
from shared.messages.registration import LocalisationRecord
from shared.messages.stored_images import (
    LocalisationReply,
    LocalisationRequest,
    Skip,
    SkipCode,
    Step,
    StoredImage,
    StoredImagesReply,
    StoredImagesRequest,
)
from shared.runtime.logging import Log
from shared.threads import supervised_thread

EVERY_S: Final = 2.0
_TIMEOUT_S: Final = 1.0
# Chosen: how long a round of asking waits for what it found to be recorded, and how many images it asks for at once.
_RECORDED_WITHIN_S: Final = 10.0
_MOST_AT_ONCE: Final = 16
_CASES_WATCHED: Final = 2


@dataclass(frozen=True, slots=True)
class Recorder:
    """What the inbox records in its turn."""

    images: Callable[[tuple[StoredImage, ...]], None]
    calibration: Callable[[bytes], None]
    localisation: Callable[[LocalisationRecord], None]
    skip: Callable[[Case, ImageReceived, Skip], None]
    later: Callable[[Callable[[], None]], bool]


class CatchUp:
    """One thread of its own: whoever is asked may be slow, and nothing waits for it."""

    def __init__(self, bus: Bus, keys: Keys, record: CaseRecord, recorder: Recorder, log: Log) -> None:
        self._bus, self._keys, self._record = bus, keys, record
        self._recorder, self._log = recorder, log
        self._wake = threading.Event()
        self._ended = threading.Event()
        self._store_id: str | None = None
        self._cases = 0  # how many of the newest are watched; 0: all of them, for the first time
        self._thread = supervised_thread("catch up", self._work)

    def start(self) -> None:
        """Begin to ask."""
        self._thread.start()

    def wake(self) -> None:
        """Ask now: a gap shows, or a service is back."""
        self._wake.set()

    def close(self) -> None:
        """Ask no more."""
        self._ended.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(_TIMEOUT_S + 1.0)

    def _work(self) -> None:
        while not self._ended.is_set():
            self._wake.clear()
            self._try(self._ask_for_images)
            self._ask_for_results()
            self._wake.wait(EVERY_S)

    def _try(self, ask: Callable[[], None]) -> None:
        """Ask; a service that is gone, busy or of another version is asked again in two seconds."""
        try:
            ask()
        except DistalockError as error:
            self._log.debug("catch_up", detail=str(error))

    def _ask_for_images(self) -> None:
        """Have every image recorded that imaging has stored."""
        while not self._ended.is_set():
            reply = self._stored_after(self._on_record(self._store_id).through)
            if reply.store_id != self._store_id:
                self._store_id = reply.store_id
                continue
            before = self._on_record(reply.store_id)
            missed = tuple(one for one in reply.images if one.header.sequence not in before)
            if missed:
                self._log.info("images_missed", count=len(missed), first=missed[0].header.sequence)
                self._recorded(partial(self._recorder.images, missed))
            if not missed or self._on_record(reply.store_id) == before or before.through >= reply.newest:
                return

    def _on_record(self, store_id: str | None) -> NumbersOnRecord:
        return self._record.ledger.images.get(store_id or "", NumbersOnRecord())

    def _stored_after(self, sequence: int, most: int = _MOST_AT_ONCE) -> StoredImagesReply:
        request = encode(StoredImagesRequest(after=sequence, most=most))
        return decode(StoredImagesReply, self._bus.query(self._keys.stored_images, request, _TIMEOUT_S).payload)

    def _ask_for_results(self) -> None:
        for case in self._watched_cases():
            for image in unfinished(case).to_calibrate[:_MOST_AT_ONCE]:
                self._try(partial(self._ask_for_calibration, case, image))
        for case in self._watched_cases():
            for image in unfinished(case).to_localise[:_MOST_AT_ONCE]:
                self._try(partial(self._ask_for_localisation, case, image))
        self._cases = _CASES_WATCHED

    def _watched_cases(self) -> list[Case]:
        """The newest first; all of them for the first time."""
        cases = list(self._record.ledger.cases.values())
        return cases[::-1][: self._cases or None]

    def _ask_for_calibration(self, case: Case, image: ImageReceived) -> None:
        assert image.sequence is not None
        if self._store_id is None:
            return  # imaging has not answered since the gateway started
        reply = self._stored_after(image.sequence - 1, most=1)
        stored = next((one for one in reply.images if one.header.sha256 == image.image_sha256), None)
        if reply.store_id != image.store_id or stored is None:
            message = "imaging stores images elsewhere than when it received it; take another image"
            self._skip(case, image, Skip(step=Step.CALIBRATION, code=SkipCode.ANOTHER_STORE, message=message))
        elif stored.calibration == "done":
            content = self._bus.query(self._keys.calibration_of(image.sequence), b"", _TIMEOUT_S).payload
            self._recorded(lambda: self._recorder.calibration(content))
        elif stored.skip is not None:
            self._skip(case, image, stored.skip)

    def _ask_for_localisation(self, case: Case, image: ImageReceived) -> None:
        opened, calibrated = self._record.ledger.open_case(), case.calibration_of(image.image_sha256)
        assert calibrated is not None
        request = LocalisationRequest(
            calibration=decode(CalibrationMessage, self._record.document(calibrated.document_sha256)),
            newest=_reference(case.images[-1]),
            open_case_id=None if opened is None else opened.case_id,
            open_case_revision=0 if opened is None else opened.revision,
        )
        answer = self._bus.query(self._keys.localisation_request, encode(request), _TIMEOUT_S)
        reply = decode(LocalisationReply, answer.payload)
        if reply.record is not None:
            record = reply.record
            self._recorded(lambda: self._recorder.localisation(record))
        elif reply.skip is not None:
            self._skip(case, image, reply.skip)

    def _skip(self, case: Case, image: ImageReceived, skip: Skip) -> None:
        self._recorded(lambda: self._recorder.skip(case, image, skip))

    def _recorded(self, work: Callable[[], None]) -> None:
        """Have the inbox record something, and wait for it: what is asked for next depends on it."""
        done = threading.Event()

        def record() -> None:
            try:
                work()
            finally:
                done.set()

        if self._recorder.later(record):
            done.wait(_RECORDED_WITHIN_S)


def _reference(image: ImageReceived) -> ImageReference:
    return ImageReference(
        sha256=image.image_sha256,
        sop_instance_uid=image.sop_instance_uid,
        sequence=image.sequence or 0,
        received_at_ns=image.received_at_ns,
        store_id=image.store_id,
    )
