"""A serial line to a controller: one background reader, one question at a time, and a stop that waits for neither.

Three locks keep apart what must not wait for another:

- the question lock is held from a question to its answer (by one thread at a time);
- the write lock is held only while bytes are handed to the operating system;
- the stop takes the write lock if it can have it at once, and writes regardless if it cannot: the controller must
  recognise the stop message anywhere in the stream.

Every command that could set the robot in motion is written under the write lock after a check of the stop flag, and the
flag is checked once more afterwards. So either the stop's bytes follow the command's, or the command never goes out.
"""

import contextlib
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import serial

from services.robot.core.tuning import CONTROLLER_LINE, GUARDING
from services.robot.devices.controller import ControllerSilent, ReplyGarbled, StopInForce, garbled
from services.robot.devices.guardian import LineGuardian, file_number_of
from services.robot.devices.serial_port import Port
from shared.errors import DeviceError
from shared.threads import supervised_thread

# Bounds on memory, far above any answer: what exceeds them is garbage.
LONGEST_LINE = 1024
MOST_LINES = 128
MOST_STALE_REPLIES = 64
# Derived: one reply time-out for an answer that is late, and one for the marker's; who asks may have a motion to watch.
FIND_STEP_TIMEOUTS = 2.0

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class LineProtocol:
    """What a line must know of a controller's dialect. Answers are lines of text that end in LF.

    Attributes
    ----------
    stop_message
        What stops the robot, at any place in the stream: as short as possible, because it is written by itself, before
        anything else.
    lock_message
        What locks it blindly, right after: so that it holds although the line spoils a command.
    marker_question, marker_answer
        A question and its only possible answer (its lines), which resembles no other answer: used to find the place in
        the stream again after silence or garbage.
    another_line_follows
        Whether a received line, without its LF, is followed by another one of the same answer.
    """

    stop_message: bytes
    lock_message: bytes
    marker_question: bytes
    marker_answer: tuple[str, ...]
    another_line_follows: Callable[[str], bool]


class SerialLine:
    """Questions and commands over a port, watched over by a guardian. Starts with the stop in force."""

    def __init__(self, port: Port, protocol: LineProtocol, reply_timeout_s: float, guardian: LineGuardian) -> None:
        self._port = port
        self._guardian = guardian
        self._protocol = protocol
        self._reply_timeout_s = reply_timeout_s
        self._question_lock = threading.Lock()
        self._write_lock = threading.Lock()
        self._stop = threading.Event()
        self._stop.set()
        self._closing = threading.Event()
        self._lost = ""
        self._lock_written_s = float("-inf")
        self._in_step = True
        self._take_late: Callable[[list[str]], None] | None = None
        self._forget_partial = threading.Event()
        self._replies: queue.Queue[list[str]] = queue.Queue(maxsize=MOST_STALE_REPLIES)
        self._reader = supervised_thread("controller-reader", self._read_forever)
        self._reader.start()
        guardian.watch(file_number_of(port), protocol.stop_message, protocol.lock_message)

    def ask(self, question: bytes, parse: Callable[[list[str]], T]) -> T:
        """Ask, and ask again when the answer is garbled: for questions that change nothing.

        Raises
        ------
        ControllerSilent
            When no answer comes in time.
        ReplyGarbled
            When three answers are garbled, or time runs out over it: who asks may have a motion to watch.
        """
        deadline_s = time.monotonic() + self._reply_timeout_s
        for _ in range(CONTROLLER_LINE.read_attempts - 1):
            try:
                return self.ask_once(question, parse)
            except ReplyGarbled:
                if time.monotonic() > deadline_s:
                    raise
        return self.ask_once(question, parse)

    def ask_once(
        self, question: bytes, parse: Callable[[list[str]], T], take_late: Callable[[list[str]], None] | None = None
    ) -> T:
        """Ask once; raises `ControllerSilent` or `ReplyGarbled`.

        Parameters
        ----------
        take_late
            Called once with the first reply that comes after silence: the answer if it was late, the marker's if it was
            lost. For questions whose answer must not get lost.
        """
        with self._question_lock:
            self._guardian.keep_alive()
            if not self._in_step:
                self._find_step()
            self._drop_stale_replies()
            self._in_step = False
            self.write(question)
            value = parse(self._reply_or_late(question, take_late))
            self._in_step = True
            return value

    def _reply_or_late(self, question: bytes, take_late: Callable[[list[str]], None] | None) -> list[str]:
        try:
            return self._next_reply(question, self._reply_timeout_s)
        except ControllerSilent:
            self._take_late = take_late
            raise

    def write(self, message: bytes) -> None:
        """Send a command that cannot set anything in motion."""
        with self._write_lock:
            self._hand_over(message)

    def write_unless_stopped(self, message: bytes) -> None:
        """Send a command that could lead to motion, with the guardian armed.

        Raises
        ------
        StopInForce
            When a stop came before or meanwhile, the guardian's too.
        GuardianLost
            When nobody would stop the robot if this service could not.
        """
        self._guardian.arm()
        with self._write_lock:
            if self._stop.is_set():
                raise StopInForce("a stop is in force: the motion command was not sent")
            try:
                self._hand_over(message)
            finally:
                self._lock_written_s = float("-inf")
        if self._stop.is_set():
            self.stop_now()
            raise StopInForce("a stop came while the motion command was being sent: it was stopped")
        try:
            self._guardian.keep_alive()
        except DeviceError:
            # This process stood still after it had looked, and the guardian's stop went out before the command.
            self.stop_now()
            raise

    def wait_for_guardian(self) -> None:
        """Wait until the guardian watches: the last step of connecting. Raises `GuardianLost`."""
        self._guardian.wait_until_ready()

    def note_locked(self) -> None:
        """The robot is locked, as read back: it needs no guardian until the next command that could lead to motion."""
        self._guardian.disarm()

    def stop_now(self) -> DeviceError | None:
        """Stop and lock at once, from any thread. Never raises and never waits for an answer.

        Returns why the line did not take every byte, None when it did.
        """
        self._stop.set()
        got_lock = self._write_lock.acquire(timeout=CONTROLLER_LINE.stop_waits_for_writer_s)
        try:
            self._hand_over(self._protocol.stop_message)
            self._hand_over_lock()
        except DeviceError as error:
            return error
        else:
            return None
        finally:
            if got_lock:
                self._write_lock.release()

    def release_stop(self) -> None:
        """Let commands that could lead to motion through again."""
        self._stop.clear()

    def close(self) -> None:
        """Leave the line."""
        self._closing.set()
        self._reader.join()
        self._guardian.leave()
        self._port.close()

    def _find_step(self) -> None:
        """Discard answers that come late until the marker's has come: answers keep their order."""
        if self._take_late is None:  # what has come of a late answer belongs to its rest
            self._forget_partial.set()
        question = self._protocol.marker_question
        self.write(question)
        last: list[str] = []
        deadline_s = time.monotonic() + FIND_STEP_TIMEOUTS * self._reply_timeout_s
        for _ in range(MOST_STALE_REPLIES):
            try:
                reply = self._next_reply(question, min(self._reply_timeout_s, deadline_s - time.monotonic()))
            except ControllerSilent:
                if last:
                    raise garbled(_shown(question), last) from None
                raise
            if self._take_late is not None:
                take_late, self._take_late = self._take_late, None
                take_late(reply)
            if reply == list(self._protocol.marker_answer):
                self._in_step = True
                return
            last = reply
        raise garbled(_shown(question), last)

    def _next_reply(self, question: bytes, within_s: float) -> list[str]:
        deadline_s = time.monotonic() + within_s
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            with contextlib.suppress(queue.Empty):
                return self._replies.get(timeout=min(left_s, GUARDING.sign_of_life_s))
            self._guardian.keep_alive()
        cause = self._lost or f"no answer to '{_shown(question)}' within {self._reply_timeout_s:g} s"
        raise ControllerSilent(f"the hexapod controller is silent: {cause}; check its power and cable")

    def _drop_stale_replies(self) -> None:
        with contextlib.suppress(queue.Empty):
            while True:
                self._replies.get_nowait()

    def _hand_over(self, message: bytes) -> None:
        try:
            self._port.write(message)
        except (serial.SerialException, OSError) as error:
            raise ControllerSilent(f"the line to the hexapod controller is broken: {error}; check the cable") from None

    def _hand_over_lock(self) -> None:
        """Lock blindly, unless just that is on its way: stops that come together must not queue up on a slow line."""
        if time.monotonic() - self._lock_written_s < CONTROLLER_LINE.lock_again_after_s:
            return
        self._hand_over(self._protocol.lock_message)
        self._lock_written_s = time.monotonic()

    def _read_forever(self) -> None:
        line, reply = bytearray(), list[str]()
        while not self._closing.is_set():
            try:
                received = self._port.read(1)
            except (serial.SerialException, OSError) as error:
                self._lost = f"the line is broken ({error})"
                return
            if self._forget_partial.is_set():
                # The rest of what was begun never came: it must not spoil the beginning of the next answer.
                self._forget_partial.clear()
                line.clear()
                reply = []
            line += received
            if line.endswith(b"\n"):
                reply.append(line.decode("ascii", errors="replace")[:-1].rstrip("\r"))
                line.clear()
                if not self._protocol.another_line_follows(reply[-1]) or len(reply) >= MOST_LINES:
                    self._keep([text.strip(" ") for text in reply])
                    reply = []
            del line[:-LONGEST_LINE]

    def _keep(self, reply: list[str]) -> None:
        # A full queue means that nobody waits for these answers: the newest are as worthless as the oldest.
        with contextlib.suppress(queue.Full):
            self._replies.put_nowait(reply)


def _shown(question: bytes) -> str:
    """A question as messages quote it; a control character by its number."""
    text = question.decode("ascii", errors="replace").strip()
    return text if text.isprintable() and text else f"#{question[0]}"
