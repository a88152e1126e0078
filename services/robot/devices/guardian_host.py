"""Runs guardians for a robot service in another container: `python -I -S guardian_host.py SOCKET`.

A guardian that is a child of the robot service dies with its container: the kernel ends every process of a container
with the first one. So the service hands the open line and its own end of the conversation to this program (SCM_RIGHTS),
which starts the guardian with them. It knows nothing of lines and robots, and imports the standard library alone.

One connection, one guardian. The first message holds its arguments, one a line, and the two file numbers. ``K`` ends
the guardian by force; a connection that closes, as of a service that was killed, leaves it to its work. When it has
ended, the connection is closed.
"""

import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

_SCRIPT = Path(__file__).with_name("guardian_process.py")
KILL = b"K"
# Chosen: many times what is ever said.
_MOST_BYTES = 4096
_HANDED = 2
# Chosen: often enough for the end of a guardian, which nobody waits for but one who starts another.
_LOOK_EVERY_S = 0.1


class _Hosted:
    """One guardian and the connection that asked for it."""

    def __init__(self, connection: socket.socket, process: subprocess.Popen[bytes]) -> None:
        self._connection = connection
        self._process = process
        self._heard = True

    def handle(self) -> None:
        """Obey what the service says, where it says something."""
        try:
            said = self._connection.recv(_MOST_BYTES, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        except OSError:
            said = b""
        if KILL in said:
            self._process.kill()
        self._heard = bool(said)

    def fileno(self) -> int:
        """Of the connection, to wait for."""
        return self._connection.fileno()

    @property
    def is_heard(self) -> bool:
        """Whether the service is still there."""
        return self._heard

    def has_ended(self) -> bool:
        """Whether the guardian has ended; the service is told by the connection's end."""
        if self._process.poll() is None:
            return False
        self._connection.close()
        return True


def _started(connection: socket.socket) -> _Hosted | None:
    """The guardian that a connection asks for; None when it asks for none, as a health check does."""
    connection.settimeout(1.0)
    content, numbers, _, _ = socket.recv_fds(connection, _MOST_BYTES, _HANDED)
    try:
        if len(numbers) != _HANDED or not content:
            return None
        line, service = numbers
        words = [sys.executable, "-I", "-S", str(_SCRIPT), str(line), str(service), *content.decode().split("\n")]
        process = subprocess.Popen(  # noqa: S603 - our own interpreter and script
            words, pass_fds=(line, service), stdin=subprocess.DEVNULL, start_new_session=True
        )
        return _Hosted(connection, process)
    finally:
        for number in numbers:
            os.close(number)


def _accepted(listening: socket.socket) -> _Hosted | None:
    connection, _ = listening.accept()
    try:
        started = _started(connection)
    except (OSError, UnicodeDecodeError) as error:
        print(f"guardian host: {error}", file=sys.stderr, flush=True)  # noqa: T201 - its log
        started = None
    if started is None:
        connection.close()
    return started


def serve(listening: socket.socket, ending: Callable[[], bool]) -> None:
    """Take connections until it is to end and no guardian is at work any more."""
    hosted: list[_Hosted] = []
    while hosted or not ending():
        waiting: list[socket.socket | _Hosted] = [listening, *(one for one in hosted if one.is_heard)]
        ready, _, _ = select.select(waiting, [], [], _LOOK_EVERY_S)
        for one in ready:
            if isinstance(one, _Hosted):
                one.handle()
            elif (started := _accepted(listening)) is not None:
                hosted.append(started)
        hosted = [one for one in hosted if not one.has_ended()]


def main(path: str) -> None:
    """Listen at a path, which only this user may use."""
    with suppress(FileNotFoundError):
        os.unlink(path)  # noqa: PTH108 - no more imports than needed
    os.umask(0o177)
    with suppress(OSError):  # real-time scheduling, where it is allowed: what it starts has it too
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    ended: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda received, _: ended.append(received))
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(path)
        listening.listen()
        serve(listening, lambda: bool(ended))


if __name__ == "__main__":
    main(sys.argv[1])
