"""Watches what the router refuses: reads what Zenoh logs, counts it, writes it to the log and publishes it.

Zenoh logs on the threads that carry the messages, to the standard output. So this is a pipe that never makes a writer
wait: when it is full, lines are lost, which is counted, and messages go on.
"""

import fcntl
import json
import os
import select
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from datetime import UTC, datetime
from typing import Final

from shared.bus.access import CLIENTS
from shared.bus.refusal_tally import RefusalTally
from shared.bus.router_log import LogLine, RouterLogReader
from shared.messages.base import encode
from shared.messages.refusals import BusRefusal
from shared.threads import report_error, supervised_thread

_STDOUT: Final = 1
# A quarter of a minute of what is logged while the robot moves (70 kB/s); the most that a process may ask for.
_PIPE_BYTES: Final = 2**20
# Chosen: an ordinary look takes one read.
_CHUNK_BYTES: Final = 2**16
# Chosen: twenty looks a second cost nothing that shows, and a refusal is on record long before anybody asks for it.
_LOOK_EVERY_S: Final = 0.05
# Chosen: when nothing is logged, a report that is due waits no longer than this.
_WAIT_S: Final = 0.25
# Chosen: a line without an end must not fill the memory.
_LONGEST_LINE: Final = 2**14
# Of a flood of different refusals as many lines a second go to the log; their number is in each.
_MOST_LINES: Final = 8

Publish = Callable[[bytes], None]


class RouterLog:
    """The reading end of what Zenoh logs, and where lines for people go instead."""

    def __init__(self, pipe: int, output: int) -> None:
        self._pipe, self._output = pipe, output
        self._rest = b""
        self._capacity = fcntl.fcntl(pipe, fcntl.F_GETPIPE_SZ)
        self.overran = False

    def wait(self, timeout_s: float) -> None:
        """Until there is something to read, or a time has passed."""
        select.select([self._pipe], [], [], timeout_s)

    def lines(self) -> Iterator[str]:
        """Whole lines that are there now."""
        taken = 0
        with suppress(BlockingIOError):
            while taken < self._capacity and (chunk := os.read(self._pipe, _CHUNK_BYTES)):
                taken += len(chunk)
                *whole, self._rest = (self._rest + chunk).split(b"\n")
                self._rest = self._rest[-_LONGEST_LINE:]
                yield from (line.decode(errors="replace") for line in whole)
        self.overran = taken >= self._capacity - _CHUNK_BYTES

    def write(self, line: str) -> None:
        """A line for people; it is lost where nobody takes it."""
        with suppress(OSError):
            os.write(self._output, f"{line}\n".encode())


@contextmanager
def captured_log() -> Iterator[RouterLog]:
    """Zenoh's log, for as long as the context lasts; call before a session is opened."""
    output, (reader, writer) = os.dup(_STDOUT), os.pipe()
    os.set_blocking(reader, False)
    os.set_blocking(writer, False)
    with suppress(OSError):  # a system may allow less
        fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
    sys.stdout.flush()
    os.dup2(writer, _STDOUT)
    os.close(writer)
    try:
        # What Python itself prints from now on must not come back as a line of Zenoh's.
        with redirect_stdout(sys.stderr):
            yield RouterLog(reader, output)
    finally:
        os.dup2(output, _STDOUT)
        os.close(reader)
        os.close(output)


class RefusalWatch:
    """Reads on a thread of its own from `start` to `close`."""

    def __init__(self, log: RouterLog, router_epoch: str, publish: Publish, clients: Collection[str] = CLIENTS) -> None:
        self._log, self._publish = log, publish
        self._reader, self._tally = RouterLogReader(clients), RefusalTally(router_epoch)
        self._ending = threading.Event()
        self._thread = supervised_thread("refusals", self._work)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def close(self) -> None:
        """Read what is there, then end."""
        self._ending.set()
        self._thread.join(5.0)

    def _work(self) -> None:
        while not self._ending.wait(_LOOK_EVERY_S):
            self._log.wait(_WAIT_S)
            self._round()
        self._round()

    def _round(self) -> None:
        try:
            self._take()
            self._report()
        except Exception as error:  # noqa: BLE001 - the border of a task: a strange line must not end the router
            report_error("the watch for refusals", error)

    def _take(self) -> None:
        for line in self._log.lines():
            seen = self._reader.read(line)
            if isinstance(seen, LogLine):
                self._log.write(seen.text)
            elif seen is not None:
                self._tally.note(seen, time.time_ns())
        if self._log.overran:
            self._tally.note_gap()

    def _report(self) -> None:
        due = self._tally.due(time.monotonic())
        if due is None:
            return
        message, changed = due
        for refusal in changed[-_MOST_LINES:]:
            self._log.write(log_line(refusal))
        self._publish(encode(message))


def log_line(refusal: BusRefusal) -> str:
    """One refusal as a line of JSON, as services log."""
    at = datetime.fromtimestamp(refusal.last_at_ns / 1e9, UTC).isoformat()
    content = {"level": "warning", "event": "refused", "timestamp": at, **refusal.model_dump(exclude={"last_at_ns"})}
    return json.dumps(content)


@contextmanager
def watched(log: RouterLog, router_epoch: str, publish: Publish, clients: Collection[str] = CLIENTS) -> Iterator[None]:
    """Watch for as long as the context lasts; `clients` are those that have rules."""
    watch = RefusalWatch(log, router_epoch, publish, clients)
    watch.start()
    try:
        yield
    finally:
        watch.close()
