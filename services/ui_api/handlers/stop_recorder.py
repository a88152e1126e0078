"""Stops on their way into the record: whoever stops hands over what came of it and waits for nothing."""

import threading
from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Final

import structlog

from services.ui_api.core.events import EventDraft
from services.ui_api.core.robot_event_data import StopRequested
from services.ui_api.handlers.stop import StopOutcome
from services.ui_api.record.record import CaseRecord
from shared.errors import RecordUnavailable
from shared.threads import supervised_thread

_log = structlog.stdlib.get_logger("distalock.ui_api")

# Chosen: four attempts a second are no load; leaving waits for a record that is busy, not for one that is gone.
_AGAIN_AFTER_S: Final = 0.25
_LEAVE_WITHIN_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class _Note:
    """What is to be recorded; `recorded` is done when it is."""

    outcome: StopOutcome
    reason: str
    who: str
    recorded: "Future[None]"


class StopRecorder:
    """Records stops in their order, on a thread of its own, again and again while the record takes nothing.

    What waits has no bound but memory: a stop is some hundred bytes, and none may be lost. Only a kill of the process
    loses those that wait; on leaving with a record that takes nothing, each is logged.
    """

    def __init__(self, record: CaseRecord) -> None:
        self._record = record
        self._changed = threading.Condition()
        self._waiting: deque[_Note] = deque()
        self._closing = False
        self._thread = supervised_thread("stop record", self._work)

    def start(self) -> None:
        """Begin to record."""
        self._thread.start()

    def close(self) -> None:
        """Record what waits, then end."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(_LEAVE_WITHIN_S)
        for note in tuple(self._waiting):
            _log.error("stop_not_recorded", reason=note.reason, who=note.who, confirmed=note.outcome.confirmed)

    def put(self, outcome: StopOutcome, reason: str, who: str) -> "Future[None]":
        """Hand over a stop that was sent; the future is done when it is on record. Never waits."""
        note = _Note(outcome, reason, who, Future())
        note.recorded.set_running_or_notify_cancel()  # from now on nobody who waits can give it up
        with self._changed:
            self._waiting.append(note)
            self._changed.notify_all()
        return note.recorded

    def __len__(self) -> int:
        return len(self._waiting)

    def _work(self) -> None:
        while (note := self._oldest()) is not None:
            try:
                self._append(note)
            except RecordUnavailable as error:
                if self._closing:
                    return
                _log.warning("stop_waits_for_record", waiting=len(self), detail=str(error))
                with self._changed:
                    self._changed.wait_for(lambda: self._closing, _AGAIN_AFTER_S)
                continue
            self._waiting.popleft()
            note.recorded.set_result(None)

    def _oldest(self) -> _Note | None:
        """The stop that has waited longest; None when closed and nothing waits."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closing)
            return self._waiting[0] if self._waiting else None

    def _append(self, note: _Note) -> None:
        with self._record.write() as unit:
            case = self._record.ledger.open_case()
            data = StopRequested(note.reason, note.outcome.confirmed, note.outcome.message)
            unit.append(EventDraft(data, case.case_id if case else None, note.who, note.reason))
