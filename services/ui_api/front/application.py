"""The application process as the front has it: started by it, watched over, told of stops, ended with it."""

import asyncio
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import structlog
from pydantic import ValidationError

from services.ui_api.link_messages import (
    BEATS_WITHIN_S,
    FROM_APPLICATION,
    Beat,
    FromApplication,
    FromFront,
    Listening,
    StopRecorded,
)
from shared.runtime.watchdog import Watchdog
from shared.scheduling import ordinary
from shared.threads import supervised_thread

_log = structlog.stdlib.get_logger("distalock.ui_api")

_MODULE: Final = "services.ui_api.application"
# Chosen: as many as the front has connections; the kernel caps it (`somaxconn`).
_BACKLOG: Final = 1024
# The application's own connections to clients get 3 s, its record 5 s.
_LEAVES_WITHIN_S: Final = 7.0


class ApplicationLink:
    """The front's end of the link to the application: one line of JSON for each message.

    Attributes
    ----------
    on_recorded
        Called with a stop's number when it is on record.
    on_streams
        Called with the number of connections that stream in the application.
    """

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self.on_recorded: Callable[[int], None] = lambda _: None
        self.on_streams: Callable[[int], None] = lambda _: None
        self._watchdog = Watchdog(BEATS_WITHIN_S, clock_s)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._early: list[FromFront] = []
        self._lock = threading.Lock()
        self._alive = False
        self._leaving = False
        self.listening = False

    def leave(self) -> None:
        """The gateway leaves: from now on there is no sign of life of it, so that a motion ends at once."""
        self._leaving = True

    def is_alive(self) -> bool:
        """Whether the application has been heard a moment ago: the gateway's heartbeats depend on it."""
        if self._leaving:
            return False
        alive = not self._watchdog.expired()
        if alive is not self._alive:
            self._alive = alive
            if self.listening:
                _log.warning("application_heard_again" if alive else "application_silent", limit_s=BEATS_WITHIN_S)
        return alive

    def tell(self, message: FromFront) -> None:
        """Send a message, from any thread; never waits. What is given before the link is there, is sent then."""
        with self._lock:
            if self._loop is None:
                self._early.append(message)
            elif not self._loop.is_closed():
                self._loop.call_soon_threadsafe(self._write, message)

    async def run(self, line: socket.socket) -> None:
        """Listen until the application ends."""
        reader, self._writer = await asyncio.open_unix_connection(sock=line)
        with self._lock:
            self._loop = asyncio.get_running_loop()
            early, self._early = self._early, []
        for message in early:
            self._write(message)
        try:
            while content := await reader.readline():
                self._take(FROM_APPLICATION.validate_json(content))
        except (OSError, ValidationError) as error:
            _log.error("application_link_broken", detail=str(error))
        finally:
            self._watchdog.forget()
            self._writer.close()

    def _write(self, message: FromFront) -> None:
        if self._writer is not None and not self._writer.is_closing():
            self._writer.write(message.line())

    def _take(self, message: FromApplication) -> None:
        match message:
            case Beat(streams=streams):
                self._watchdog.feed()
                self.on_streams(streams)
            case Listening():
                self.listening = True
            case StopRecorded(number=number):
                self.on_recorded(number)


@dataclass(slots=True)
class ApplicationProcess:
    """The process, its link, the socket that connections are handed over, and where it takes requests."""

    process: "subprocess.Popen[bytes]"
    line: socket.socket
    streams: socket.socket
    address: Path
    leaving: threading.Event = field(default_factory=threading.Event)

    def watch(self, on_end: Callable[[int], None]) -> None:
        """Wait for its end; called with its code when nobody had asked for it."""
        code = self.process.wait()
        if not self.leaving.is_set():
            on_end(code)

    def end(self) -> None:
        """Ask it to end, and force it when it does not."""
        if self.leaving.is_set():
            return
        self.leaving.set()
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(_LEAVES_WITHIN_S)
        except subprocess.TimeoutExpired:
            _log.error("application_killed", detail=f"it did not end within {_LEAVES_WITHIN_S:g} s")
            self.process.kill()
            self.process.wait()


@contextmanager
def running_application(
    arguments: Sequence[str], on_end: Callable[[int], None], module: str = _MODULE
) -> Iterator[ApplicationProcess]:
    """Run the application for as long as the context lasts.

    It inherits its end of the link, and the socket on which it takes requests, in a folder that only this user can
    enter. It ends when the link does, however this process ends.
    """
    with tempfile.TemporaryDirectory(prefix="distalock-") as folder:
        address = Path(folder) / "application.sock"
        (ours, its), (giving, taking) = socket.socketpair(), socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with ours, its, giving, taking, socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listening:
            listening.bind(str(address))
            listening.listen(_BACKLOG)
            handed_on = {"--link": its.fileno(), "--streams": taking.fileno(), "--listening": listening.fileno()}
            options = [word for option, handle in handed_on.items() for word in (option, str(handle))]
            command = [sys.executable, "-m", module, *options, *arguments]
            with ordinary():  # it computes, and must not keep the processor from a stop
                process = subprocess.Popen(command, pass_fds=tuple(handed_on.values()))  # noqa: S603 - our own module
            for handle in (its, taking, listening):
                handle.close()
            application = ApplicationProcess(process, ours, giving, address)
            supervised_thread("application", lambda: application.watch(on_end)).start()
            try:
                yield application
            finally:
                application.end()
