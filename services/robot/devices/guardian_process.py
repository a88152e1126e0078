"""The guardian: a small process that stops and locks the robot when the robot service cannot any more.

It holds the same open line as the service, and one end of a pair of sockets. While it is armed it expects a sign of
life every now and then; when the service has gone (end of file) or is silent, it writes the stop and the lock itself.
It is run as a script, by `guardian.Guardian`, and imports nothing but the standard library: it must start at once and
take little memory, so that whatever ends the service for want of memory does not end it too.

Messages are single bytes. Each of the service's is answered with itself.
"""

import os
import select
import signal
import sys
import time
from contextlib import suppress

ARM, KEEP_ALIVE, DISARM = b"A", b"K", b"D"
READY, STOPPED = b"R", b"S"
# A disturbed line can spoil one message: the stop is written this often.
ROUNDS = 3
BETWEEN_ROUNDS_S = 0.05
# A line that takes nothing for so long is left to the next service, which waits for it.
GIVE_UP_AFTER_S = 3.0
_WRITE_WITHIN_S = 0.1
_MOST_MESSAGES = 4096


class Guardian:
    """Watches over one line.

    Parameters
    ----------
    line, service
        File numbers of the open line and of the socket to the service.
    stop_message, lock_message
        What stops, and what locks blindly; two writes, so that the stop does not wait for the lock.
    silence_s
        Longest silence of the service while the guardian is armed.
    """

    def __init__(self, line: int, service: int, stop_message: bytes, lock_message: bytes, silence_s: float) -> None:
        self._line = line
        self._service = service
        self._messages = (stop_message, lock_message)
        self._silence_s = silence_s
        self._armed = False
        self._heard_s = time.monotonic()

    def watch(self) -> None:
        """Until the service has gone. Whatever ends this, the robot is stopped first if it may be in motion."""
        try:
            self._tell(READY)
            while self._hear():
                pass
        finally:
            if self._armed:
                self._stop_robot()

    def _hear(self) -> bool:
        """Wait for the service and do what it says; False when it has gone."""
        if not _ready(self._service, select.POLLIN, self._patience_s()):
            self._stop_robot()
            return True
        try:
            received = os.read(self._service, _MOST_MESSAGES)
        except OSError:  # gone before it had read every answer
            return False
        self._obey(received)
        return bool(received)

    def _patience_s(self) -> float | None:
        """How long to wait for a sign of life; None for as long as it takes.

        Asked for right before waiting: a guardian that was itself stopped finds the signs of life that came meanwhile.
        """
        return max(self._heard_s + self._silence_s - time.monotonic(), 0.0) if self._armed else None

    def _obey(self, received: bytes) -> None:
        for number in received:
            message = bytes([number])
            if message == ARM:
                self._armed = True
            elif message == DISARM:
                self._armed = False
            self._tell(message)
        self._heard_s = time.monotonic()

    def _stop_robot(self) -> None:
        """Stop and lock, some times over; the service first learns of it, so that it sends nothing after."""
        self._armed = False
        self._tell(STOPPED)
        give_up_s = time.monotonic() + GIVE_UP_AFTER_S
        written = 0
        while written < ROUNDS and time.monotonic() < give_up_s:
            written += self._write_round()
            if written < ROUNDS:
                time.sleep(BETWEEN_ROUNDS_S)

    def _write_round(self) -> bool:
        """Whether the line has taken all of it."""
        return all(_written(self._line, message) for message in self._messages)

    def _tell(self, message: bytes) -> None:
        with suppress(OSError):  # it has gone, and does not expect an answer
            os.write(self._service, message)


def _written(line: int, content: bytes) -> bool:
    """Write everything, or what the line takes. The line does not block: that is shared with the service."""
    while content:
        try:
            content = content[os.write(line, content) :]
        except BlockingIOError:
            if not _ready(line, select.POLLOUT, _WRITE_WITHIN_S):
                return False
        except OSError:
            return False
    return True


def _ready(number: int, event: int, within_s: float | None) -> bool:
    poll = select.poll()
    poll.register(number, event)
    return bool(poll.poll(None if within_s is None else 1e3 * within_s))


def main(arguments: list[str]) -> None:
    """Watch, with what `guardian.Guardian` hands over."""
    # Whoever ends the service's group, or the terminal, must not end this: it leaves when the service has left.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP, signal.SIGPIPE):
        signal.signal(number, signal.SIG_IGN)
    line, service, stop_message, lock_message, silence_s = arguments
    guardian = Guardian(
        int(line), int(service), bytes.fromhex(stop_message), bytes.fromhex(lock_message), float(silence_s)
    )
    guardian.watch()


if __name__ == "__main__":
    main(sys.argv[1:])
