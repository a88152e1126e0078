"""Stops are sent at once, however many, and recorded whenever the record takes them."""

import threading
from pathlib import Path

from services.ui_api.core.events import EventKind
from services.ui_api.handlers.stop import StopOutcome
from services.ui_api.handlers.stop_recorder import StopRecorder
from services.ui_api.handlers.stop_sender import MOST_AT_ONCE, StopSender
from services.ui_api.record.database import open_database, sqlite_url
from services.ui_api.record.record import CaseRecord
from shared.errors import RecordUnavailable
from shared.messages.robot import MotionState
from tests.unit.services.ui_api.fakes import PATIENCE_S

STOPPED = StopOutcome(confirmed=True, state=MotionState.STOPPED, message="")


class FullDisk(CaseRecord):
    """A record that takes nothing until a test lets it."""

    full = True
    refused = threading.Event()

    def require_space(self) -> None:
        if self.full:
            self.refused.set()
            raise RecordUnavailable("the disk is full")

    def write(self):  # type: ignore[no-untyped-def]  # as the record's own
        self.require_space()
        return super().write()


def test_stops_that_the_record_does_not_take_are_recorded_later_in_their_order(tmp_path: Path) -> None:
    record = FullDisk(open_database(sqlite_url(tmp_path)), lambda: 1)
    recorder = StopRecorder(record)
    recorder.start()
    reasons = [f"stop {number}" for number in range(40)]
    recording = [recorder.put(STOPPED, reason, "rest") for reason in reasons]
    assert record.refused.wait(PATIENCE_S)
    assert len(recorder) == len(reasons)
    record.full = False
    recording[-1].result(PATIENCE_S)
    recorder.close()
    events = [event for event in record.events_after(0) if event.kind is EventKind.STOP_REQUESTED]
    assert [event.why for event in events] == reasons
    record.close()


def test_a_hundred_stops_go_out_while_none_is_answered() -> None:
    sent, answered = threading.Semaphore(0), threading.Event()

    def stop(reason: str) -> StopOutcome:
        del reason
        sent.release()
        assert answered.wait(PATIENCE_S)
        return STOPPED

    sender = StopSender(stop)
    waiting = [sender.begin("a stop") for _ in range(100)]
    for _ in waiting:
        assert sent.acquire(timeout=PATIENCE_S), "a stop waited for another one's answer"
    answered.set()
    assert all(answer.result(PATIENCE_S) == STOPPED for answer in waiting)


def test_beyond_the_bound_a_stop_shares_the_answer_of_the_newest() -> None:
    answered = threading.Event()

    def stop(reason: str) -> StopOutcome:
        assert answered.wait(PATIENCE_S)
        return StopOutcome(confirmed=True, state=MotionState.STOPPED, message=reason)

    sender = StopSender(stop)
    waiting = [sender.begin(str(number)) for number in range(MOST_AT_ONCE + 2)]
    answered.set()
    assert [answer.result(PATIENCE_S).message for answer in waiting[-3:]] == [str(MOST_AT_ONCE - 1)] * 3
