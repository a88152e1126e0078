"""The robot service's end of its guardian (`guardian_process`): start it, arm it before a motion, give signs of life.

No motion without a guardian that has confirmed to be armed. One that ends or hangs in motion is a fault; at rest it is
started again. All methods but `lost` belong to the thread that talks to the controller.
"""

import select
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from services.robot.core.tuning import GUARDING
from services.robot.devices import guardian_process
from services.robot.devices.controller import StopInForce
from services.robot.devices.guardian_host import KILL
from services.robot.devices.guardian_process import ARM, DISARM, KEEP_ALIVE, READY, STOPPED
from shared.errors import DeviceError

_SCRIPT = Path(guardian_process.__file__)
# Chosen: answers of one byte each, in one read; far more than are ever under way.
_MOST_ANSWERS = 4096
# It waits for nothing when its other end is closed, but for its three rounds when the robot was not locked.
_ENDS_WITHIN_S = 1.0
_WHY_STOPPED = (
    f"because this service was silent for more than {GUARDING.silence_s:g} s: it hung or was stopped; see what else "
    "the computer does"
)


class GuardianLost(DeviceError):
    """The guardian process has ended or does not answer: nothing may move."""

    code = "guardian_missing"


class LineGuardian(Protocol):
    """Who stops the robot when the service cannot."""

    def watch(self, file_number: int | None, stop_message: bytes, lock_message: bytes) -> None:
        """Begin to watch over an open line; returns at once, so that a robot that was found moving is stopped first."""

    def wait_until_ready(self) -> None:
        """Wait until it watches; raises `GuardianLost` when it does not start."""

    def arm(self) -> None:
        """Return when it is armed; raises `GuardianLost`, or `StopInForce` when it has stopped the robot."""

    def keep_alive(self) -> None:
        """Give a sign of life, and look for its answers; raises like `arm`, once for each loss, while armed."""

    def disarm(self) -> None:
        """The robot is locked, as read back."""

    def lost(self) -> str:
        """Why nothing may move; empty when it watches. From any thread."""

    def leave(self) -> None:
        """Leave the line; wait until it has left too."""


class Unguarded:
    """For a line within one process, which ends with the service: nobody could stop what is at its end."""

    def watch(self, file_number: int | None, stop_message: bytes, lock_message: bytes) -> None:
        """See `LineGuardian`."""

    def wait_until_ready(self) -> None:
        """See `LineGuardian`."""

    def arm(self) -> None:
        """See `LineGuardian`."""

    def keep_alive(self) -> None:
        """See `LineGuardian`."""

    def disarm(self) -> None:
        """See `LineGuardian`."""

    def lost(self) -> str:
        """See `LineGuardian`."""
        return ""

    def leave(self) -> None:
        """See `LineGuardian`."""


UNGUARDED = Unguarded()


class GuardianProcess(Protocol):
    """A guardian process that was started."""

    def kill(self) -> None:
        """End it by force."""

    def has_ended(self, within_s: float) -> bool:
        """Whether it has ended, within a time."""

    def close(self) -> None:
        """Keep nothing open that was for this guardian."""


# Starts a guardian with the file numbers of the line and of its end of the conversation, and its other arguments;
# raises `OSError` when it cannot.
Launch = Callable[[int, int, Sequence[str]], GuardianProcess]


class Guardian:
    """A guardian process for the line that is open, started again when it was lost at rest.

    Parameters
    ----------
    launch
        How it is started: by this process, or by a host in another container.
    """

    def __init__(self, launch: Launch | None = None) -> None:
        self._launch = launch or child_process
        self._arguments: tuple[int, bytes, bytes] | None = None
        self._process: GuardianProcess | None = None
        self._socket: socket.socket | None = None
        self._armed = False
        self._lost = "the guardian process has not been started: no controller is connected"
        self._started_s = float("-inf")
        # When the oldest message was sent that has no answer yet.
        self._asked_s: float | None = None

    def watch(self, file_number: int | None, stop_message: bytes, lock_message: bytes) -> None:
        """See `LineGuardian`."""
        if file_number is None:
            self._lost = "this kind of line cannot be shared with a guardian process"
            return
        self._arguments = (file_number, stop_message, lock_message)
        self._start()

    def wait_until_ready(self) -> None:
        """See `LineGuardian`."""
        while self._lost:
            if self._socket is None:
                raise GuardianLost(self._lost)
            self._received(self._started_s + GUARDING.starts_within_s)
            self._check_answers()

    def arm(self) -> None:
        """See `LineGuardian`."""
        self.keep_alive()
        if self._armed:
            return
        if self._lost:
            raise GuardianLost(self._lost)
        self._send(ARM)
        deadline_s = time.monotonic() + GUARDING.answer_within_s
        answers = self._received(deadline_s)
        while ARM not in answers:
            if self._lost or time.monotonic() > deadline_s:
                self._lose(self._lost or "the guardian process did not confirm that it is armed")
                raise GuardianLost(self._lost)
            answers += self._received(deadline_s)
        if STOPPED in answers[answers.index(ARM) :]:
            raise StopInForce(f"the guardian process has stopped the robot before its motion began, {_WHY_STOPPED}")
        self._armed = True

    def keep_alive(self) -> None:
        """See `LineGuardian`."""
        was_armed = self._armed
        answers = self._received()
        self._check_answers()
        if self._lost:
            if was_armed:
                raise GuardianLost(self._lost)
            self._start_again()
            return
        self._send(KEEP_ALIVE)
        if was_armed and STOPPED in answers:
            self._armed = False
            raise StopInForce(f"the guardian process has stopped the robot, {_WHY_STOPPED}")

    def disarm(self) -> None:
        """See `LineGuardian`."""
        if self._armed:
            self._armed = False
            self._send(DISARM)

    def lost(self) -> str:
        """See `LineGuardian`."""
        return self._lost

    def leave(self) -> None:
        """See `LineGuardian`."""
        self._arguments = None
        self._end("no controller is connected")

    def _start(self) -> None:
        if self._arguments is None:
            return
        file_number, *messages = self._arguments
        self._started_s = time.monotonic()
        self._lost = "the guardian process is being started"
        ours, theirs = socket.socketpair()
        words = (*(m.hex() for m in messages), str(GUARDING.silence_s))
        try:
            self._process = self._launch(file_number, theirs.fileno(), words)
        except OSError as error:
            self._lost = f"the guardian process cannot be started: {error}"
            ours.close()
        else:
            ours.settimeout(0.0)
            self._socket = ours
            self._asked_s = None
        finally:
            theirs.close()

    def _start_again(self) -> None:
        if self._process is None and time.monotonic() - self._started_s > GUARDING.start_again_after_s:
            self._start()

    def _received(self, until_s: float | None = None) -> bytes:
        """Answers that have come; waits for some until a time, if one is given."""
        if self._socket is None:
            return b""
        if until_s is not None:
            select.select([self._socket], [], [], max(until_s - time.monotonic(), 0.0))
        try:
            answers = self._socket.recv(_MOST_ANSWERS)
        except BlockingIOError:
            return b""
        except OSError:
            answers = b""
        if not answers:
            self._lose("the guardian process has ended")
        else:
            self._asked_s = None
            if READY in answers:
                self._lost = ""
        return answers

    def _check_answers(self) -> None:
        limit_s = GUARDING.answer_within_s if self._is_ready() else GUARDING.starts_within_s
        asked_s = self._asked_s if self._is_ready() else self._started_s
        if self._socket is not None and asked_s is not None and (silent_s := time.monotonic() - asked_s) > limit_s:
            self._lose(f"the guardian process has not answered for {silent_s:.2f} s (limit {limit_s:g} s)")

    def _is_ready(self) -> bool:
        return not self._lost

    def _send(self, message: bytes) -> None:
        if self._socket is None:
            return
        with suppress(OSError):  # full or gone: the answer that does not come says so
            self._socket.send(message)
        self._asked_s = self._asked_s or time.monotonic()

    def _lose(self, why: str) -> None:
        """It is of no use any more: ended for good, so that it cannot wake up beside its successor."""
        if self._process is not None:
            self._process.kill()
        self._end(why)

    def _end(self, why: str) -> None:
        self._armed = False
        self._lost = why
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        if self._process is not None:
            if not self._process.has_ended(_ENDS_WITHIN_S):
                self._process.kill()
                self._process.has_ended(_ENDS_WITHIN_S)
            self._process.close()
            self._process = None


class ChildGuardian:
    """A guardian that this process has started."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = process

    def kill(self) -> None:
        """See `GuardianProcess`."""
        self.process.kill()

    def has_ended(self, within_s: float) -> bool:
        """See `GuardianProcess`."""
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(within_s)
        return self.process.poll() is not None

    def close(self) -> None:
        """See `GuardianProcess`."""


def child_process(line: int, service: int, words: Sequence[str]) -> GuardianProcess:
    """Start a guardian as a child, isolated and without site-packages: in a few hundredths of a second."""
    process = subprocess.Popen(  # noqa: S603 - our own interpreter and script
        [sys.executable, "-I", "-S", str(_SCRIPT), str(line), str(service), *words],
        pass_fds=(line, service),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    )
    return ChildGuardian(process)


class _Hosted:
    """A guardian that a host has started (`guardian_host`), and the connection by which it was asked to."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection

    def kill(self) -> None:
        """See `GuardianProcess`."""
        with suppress(OSError):
            self._connection.send(KILL)

    def has_ended(self, within_s: float) -> bool:
        """See `GuardianProcess`; the host closes the connection when it has."""
        ready, _, _ = select.select([self._connection], [], [], within_s)
        with suppress(OSError):
            if ready and self._connection.recv(1):
                return False
        return bool(ready)

    def close(self) -> None:
        """See `GuardianProcess`."""
        self._connection.close()


def hosted_at(path: Path) -> Launch:
    """Start guardians by the host that listens at a path."""

    def launch(line: int, service: int, words: Sequence[str]) -> GuardianProcess:
        connection = socket.socket(socket.AF_UNIX)
        try:
            connection.settimeout(_ENDS_WITHIN_S)
            connection.connect(str(path))
            socket.send_fds(connection, ["\n".join(words).encode()], [line, service])
        except OSError:
            connection.close()
            raise
        return _Hosted(connection)

    return launch


def file_number_of(port: object) -> int | None:
    """The number of a port's file or socket; None when it has none that a process could inherit."""
    # pyserial's RFC 2217 keeps its socket to itself. The messages of a stop hold no byte 255, so that they mean on that
    # socket what they mean on the line.
    for owner in (port, getattr(port, "_socket", None)):
        fileno = getattr(owner, "fileno", None)
        if fileno is not None:
            with suppress(OSError, ValueError):
                return int(fileno())
    return None
