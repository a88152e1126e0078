"""The application's end of the link to the front: beats go out, stops come in to be recorded."""

import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from typing import Final, Protocol

from services.ui_api.handlers.stop import StopOutcome
from services.ui_api.link_messages import (
    BEAT_S,
    FROM_FRONT,
    Beat,
    FromApplication,
    FromFront,
    FrontFigures,
    Listening,
    StopBegun,
    StopEnded,
    StopRecorded,
)
from shared.messages.robot import MotionState
from shared.threads import supervised_thread


class Recording(Protocol):
    """What the link does with what it hears."""

    def note_stop_begun(self) -> None:
        """A stop was sent: what waits to be sent is not sent any more."""

    def record_stop(self, outcome: StopOutcome, reason: str, who: str) -> "Future[None]":
        """Have a stop recorded; never waits."""

    def note_stop(self, outcome: StopOutcome, took_s: float) -> None:
        """Count a stop."""

    def note_front(self, figures: FrontFigures) -> None:
        """Keep how busy the front is."""


_LEAVE_WITHIN_S: Final = 1.0


class FrontLink:
    """Sends and hears over one socket.

    Parameters
    ----------
    on_end
        Called when the front has ended, however it did.
    """

    def __init__(self, line: socket.socket, on_end: Callable[[], None]) -> None:
        self._line, self._on_end = line, on_end
        self._sending = threading.Lock()
        self.streams: Callable[[], int] = lambda: 0

    @contextmanager
    def beating(self) -> Iterator[None]:
        """Tell the front that this process lives, and how many streams it has, for as long as the context lasts."""
        ended = threading.Event()

        def beat() -> None:
            while not ended.wait(BEAT_S):
                self.send(Beat(streams=self.streams()))

        thread = supervised_thread("application beat", beat)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join(_LEAVE_WITHIN_S)

    def listen(self, recording: Recording) -> None:
        """Begin to hear, and tell the front that requests are taken."""
        supervised_thread("front link", lambda: self._hear(recording)).start()
        self.send(Listening())

    def send(self, message: FromApplication) -> None:
        """Send one message; a front that has ended is noticed where it is heard."""
        with self._sending, suppress(OSError):
            self._line.sendall(message.line())

    def _hear(self, recording: Recording) -> None:
        with suppress(OSError), self._line.makefile("rb") as lines:
            for line in lines:
                self._take(FROM_FRONT.validate_json(line), recording)
        self._on_end()

    def _take(self, message: FromFront, recording: Recording) -> None:
        match message:
            case StopBegun():
                recording.note_stop_begun()
            case StopEnded():
                outcome = _outcome(message)
                recorded = recording.record_stop(outcome, message.reason, message.who)
                recorded.add_done_callback(lambda _: self.send(StopRecorded(number=message.number)))
                recording.note_stop(outcome, message.took_s)
            case FrontFigures():
                recording.note_front(message)


def _outcome(message: StopEnded) -> StopOutcome:
    state = None if message.state is None else MotionState(message.state)
    return StopOutcome(confirmed=message.confirmed, state=state, message=message.message)
