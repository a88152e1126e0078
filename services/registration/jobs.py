"""Which image is localised next: always the newest. One that waits when a newer one comes is reported as superseded.

Nothing is planned from an older image, and an image takes seconds: a queue would only make the newest one wait.
Whoever has an image on record without a localisation asks for it, and gets it, or why there is none.
"""

import threading
from collections import OrderedDict

from services.registration.state import RegistrationState
from shared.messages.imaging import CalibrationMessage
from shared.messages.stored_images import LocalisationReply, LocalisationRequest, Skip, SkipCode, Step

# Chosen: a bound on memory, above the images of the longest procedure.
_FAULTS_KEPT = 256


class LocalisationJobs:
    """What waits and what is worked on. Safe for several threads."""

    def __init__(self, state: RegistrationState) -> None:
        self._state = state
        self._changed = threading.Condition()
        self._waiting: CalibrationMessage | None = None
        self._in_work: str | None = None
        self._faults: OrderedDict[str, str] = OrderedDict()
        self._closed = False
        self.unusable_case = ""

    def put(self, message: CalibrationMessage) -> str | None:
        """Have an image localised next, unless a newer one waits; the hash of the one that is not localised."""
        with self._changed:
            before = self._waiting
            if before is not None and before.image.sha256 == message.image.sha256:
                return None
            if self._closed or (before is not None and message.image.precedes(before.image)):
                return message.image.sha256
            self._waiting = message
            self._changed.notify()
            return None if before is None else before.image.sha256

    def take(self, timeout_s: float) -> CalibrationMessage | None:
        """Wait for an image; None after `timeout_s`, or at once when closed. It is in work until `done`."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting is not None or self._closed, timeout_s)
            message, self._waiting = self._waiting, None
            self._in_work = None if message is None else message.image.sha256
            return message

    def done(self, fault: str | None = None) -> None:
        """The image in work is done, or brought a fault."""
        with self._changed:
            if self._in_work is not None and fault is not None:
                self._faults[self._in_work] = fault
                while len(self._faults) > _FAULTS_KEPT:
                    self._faults.popitem(last=False)
            self._in_work = None

    def close(self) -> None:
        """Wake whoever waits; nothing is handed out any more."""
        with self._changed:
            self._closed, self._waiting = True, None
            self._changed.notify_all()

    def reply(self, request: LocalisationRequest) -> LocalisationReply:
        """The localisation that is asked for, or why there is none; neither when it is being made from now on."""
        self._state.note_newest(request.newest)
        sha256 = request.calibration.image.sha256
        localised = self._state.images.get(sha256)
        if localised is not None:
            return LocalisationReply(record=localised.record)
        skip = self._why_not(request)
        if skip is not None:
            return LocalisationReply(skip=skip)
        if not self.is_in_hand(sha256) and self._knows_open_case(request):
            self.put(request.calibration)
        return LocalisationReply()

    def is_in_hand(self, sha256: str) -> bool:
        """Whether an image is being localised, or will be next."""
        with self._changed:
            return sha256 == self._in_work or (self._waiting is not None and self._waiting.image.sha256 == sha256)

    def _knows_open_case(self, request: LocalisationRequest) -> bool:
        """Whether what is open here is what the gateway has announced; otherwise the announcement is on its way."""
        case = self._state.case
        known = (None, 0) if case is None else (case.context.case_id, case.context.revision)
        return known == (request.open_case_id, request.open_case_revision if request.open_case_id else 0)

    def _why_not(self, request: LocalisationRequest) -> Skip | None:
        calibration, newest = request.calibration, self._state.newest
        image = calibration.image
        with self._changed:
            fault, unusable = self._faults.get(image.sha256), self.unusable_case
        if fault is not None:
            return _skip(SkipCode.FAULT, f"it brought a fault ({fault}); take another image")
        asked = (calibration.case_id, calibration.case_revision)
        if asked != (request.open_case_id, request.open_case_revision):
            message = f"it was taken in case '{asked[0]}' revision {asked[1]}, which is not the present set-up any more"
            return _skip(SkipCode.SET_UP_CHANGED, message)
        if unusable:
            return _skip(SkipCode.FAULT, f"the open case cannot be used ({unusable}); correct the case")
        if newest is not None and image.precedes(newest) and not self.is_in_hand(image.sha256):
            return _skip(
                SkipCode.SUPERSEDED,
                f"image {newest.sha256[:12]} came after it and is localised instead; take it again if it is needed",
            )
        return None


def _skip(code: SkipCode, message: str) -> Skip:
    return Skip(step=Step.LOCALISATION, code=code, message=message)
